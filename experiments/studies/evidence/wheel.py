"""Wheels on soil: slip at best tractive efficiency."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from proving_ground.testbed.inspection.traction import BANDS, cone_index_for, efficiency

from .evidence import Evidence
from .handling import farm

_ARIZONA_RULE: Final = "the source's range; surface by Bn, ASABE D497"


def best_slip() -> list[Evidence]:
    """Return the slip at best tractive efficiency on the four surfaces of the source."""
    items = []
    for band in BANDS:
        bench = farm()
        soil = replace(bench.soil, background=cone_index_for(bench, band.bn))
        check = efficiency(replace(bench, soil=soil))[1]
