"""Disturbance sets, tubes with certificates, calibration, tightening, for linear systems.

The names below are for any linear system given as arrays, of any dimension, time-varying or not
(docs/tube-library.md). `ancillary` and `reference_tube` are the tube of a tractor with its trailer.
"""

from .conformal import Calibration, calibrate, largest_score
from .disturbance_set import DisturbanceSet, Shape
from .gain import feedback_gains, search_tube
from .plots import draw_band, draw_set
from .polytope import Polytope, admissible_subset
from .residual_set import fit_set
from .sets import ConvexSet, SupportSet, linear_map, minkowski_sum, outline
from .tightening import tightened_offsets
from .tube import Certificate, TrackingSystem, Tube, invariant_tube, reachable_set

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
    "draw_band",
    "draw_set",
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
