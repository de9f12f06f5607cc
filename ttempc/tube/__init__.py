"""Disturbance sets, tubes with certificates, calibration, tightening, for linear systems.

The names below are for any linear system given as arrays, of any dimension, time-varying or not
(docs/tube-library.md). `ancillary` and `reference_tube` are the tube of a tractor with its trailer.
"""

from .conformal import Calibration, calibrate, largest_score
from .sets import (
    ConvexSet,
    DisturbanceSet,
    Polytope,
    Shape,
    SupportSet,
    admissible_subset,
    fit_set,
    linear_map,
    minkowski_sum,
    outline,
)
from .tube import (
    Certificate,
    TrackingSystem,
    Tube,
    feedback_gains,
    invariant_tube,
    reachable_set,
    search_tube,
    tightened_offsets,
)

__all__ = [
    "Calibration",
    "Certificate",
    "ConvexSet",
    "DisturbanceSet",
    "Polytope",
    "Shape",
    "SupportSet",
    "TrackingSystem",
    "Tube",
    "admissible_subset",
    "calibrate",
    "feedback_gains",
    "fit_set",
    "invariant_tube",
    "largest_score",
    "linear_map",
    "minkowski_sum",
    "outline",
    "reachable_set",
    "search_tube",
    "tightened_offsets",
]
