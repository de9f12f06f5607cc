"""Records that compiled calls of a control tick hand to each other.

A record is a flat array of float64 (`SIZE` of its type entries) that kernels view as a structured
one, `row.view(TYPE)[0]`: handing over a plain array costs a tenth of handing over a record. Views
with names and words, `Estimate` and `Diagnostics`, are made where somebody looks.
"""

from typing import Final

import numpy as np

SAMPLE: Final = 5
"""Entries of a sample: time [s], `SensorIndex`, three components; 0 where it has fewer of them."""

ESTIMATE: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("state", "f8", 7),  # see `State`
        ("trailer_xy", "f8", 2),
        ("hitch_angle", "f8"),
        ("disturbance", "f8", 5),  # see `Disturbance`
        ("map_disturbance", "f8", 4),  # see `MapDisturbance`
        ("noise_factors", "f8", 3),  # NaN where the estimator learns none
        ("covariance", "f8", (7, 7)),
        ("nis", "f8"),  # sum of the normalised squared innovations of this tick's samples
        ("nis_dof", "f8"),  # and its degrees of freedom
        ("position_seen", "f8"),  # 1 where a GNSS sample was accepted at this tick
    ]
)

ALARM: Final = 4
"""Entries of an alarm, a row for each detector: its `Reaction`, -1 where there is none, and three
numbers of which the detector makes its reason in words; they are those of the alarm's begin."""
