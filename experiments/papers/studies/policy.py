"""Errors of a learnt policy beside the controller below it and `ttempc`, paired by seed."""

from __future__ import annotations

from typing import Final

import pandas as pd

from ttempc.types import FloatArray

from ...results.statistics import caveat, mean
from ...seeds import report_seeds
from ..cells import POINTS, groups, lost, numbers
from ..study import Study
from ..tables import markdown

FACTORY: Final = "learnt_policy:learnt"  # of docs/examples


def _table(rows: pd.DataFrame) -> str:
    """Return mean errors of tractor and trailer, and the paired difference of their mean [cm]."""
    lines = []
    for field in groups(rows, ["scenario"]):
        below: FloatArray | None = None
        for own in groups(field, ["driver"]):
            errors = 100.0 * numbers(own, *POINTS)  # (seeds, 2)
            both, difference = errors.mean(axis=1), ""
            if below is None:
                below = both
            else:
                change = mean(both - below)
                low, high = change.ends
                difference = f"{change.value:+.2f} ({low:+.2f} to {high:+.2f})"
            means = " / ".join(f"{error:.1f}" for error in errors.mean(axis=0))
            first = own.iloc[0]
            name = f"`{first['scenario']}`"
            lines.append((name, first["driver"], means, difference, lost(own)))
    heads = ("field", "controller", "tractor / trailer [cm]", "difference [cm]", "lost")
    return f"{markdown(heads, lines)}\n\n{caveat(rows['seed'].nunique())}".rstrip()


_FIELDS: Final = ("wet-slope", "patchy", "grass")  # trained on the first two, with other seeds
_DRIVERS: Final = {"`pid`": "pid", "policy on `pid`": FACTORY, "`ttempc`": "ttempc"}
STUDIES: Final = (
    Study(
        name="learnt-policy",
        table=_table,
        scenarios=_FIELDS,
        axes={"driver": {key: (f'controller.name="{name}"',) for key, name in _DRIVERS.items()}},
        seeds=report_seeds(3),
        checks=tuple((name, FACTORY) for name in _FIELDS),
        minutes=1.5,
    ),
)
