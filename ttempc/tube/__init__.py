"""Disturbance sets, tubes with certificates and their calibration, for linear systems.

The names below apply to any linear system given as arrays: of any dimension, time-varying or
time-invariant. The module `reference_tube` computes the tube of a tractor with its trailer.
"""

from .conformal import Calibration, calibrate, largest_score
from .sets import (
    DisturbanceSet,
    Shape,
    SupportSet,
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
    search_tube,
)

__all__ = [
    "Calibration",
    "Certificate",
    "DisturbanceSet",
    "Shape",
    "SupportSet",
    "TrackingSystem",
    "Tube",
    "calibrate",
    "feedback_gains",
    "fit_set",
    "invariant_tube",
    "largest_score",
    "linear_map",
    "minkowski_sum",
    "outline",
    "search_tube",
]
