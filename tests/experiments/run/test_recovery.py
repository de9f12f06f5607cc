"""The default controller finds back on the plant, filter in the loop."""

from __future__ import annotations

import pytest
from proving_ground.experiments.papers.studies.laps import recover
from proving_ground.experiments.papers.study import Case


@pytest.mark.parametrize(("lateral_m", "yaw_deg"), [(1.0, 20.0), (-1.0, 20.0)])
def test_recovers_from_a_metre_and_twenty_degrees_in_fifteen_metres(lateral_m, yaw_deg):
    seen = recover(Case("grass", 1, labels={"offset": (lateral_m, yaw_deg)}), ticks=110)
    assert seen["travel_m"] < 15.0
    assert seen["overshoot_m"] < 0.20
    assert seen["excess"] < 1e-9
