"""Tube MPC: nominal state, tightened limits and an ancillary gain: the controller `ttempc-tube`."""

from typing import Final

import numpy as np

from ..mpc.articulated_error import Output, PredictedPath
from ..mpc.condensing import FreeInputs, FreeSteps
from ..mpc.lmpc import CondensedHorizon, move_bounds
from ..reference.reference import Reference
from ..tube.reference_tube import ReferenceTube, TubeDesign, report_rows
from ..vehicle import Vehicle
from .articulated_law import ArticulatedLaw
from .law_records import TUBE_MPC, law_of
from .options import MpcOptions
from .tracking_controller import ExactCourse, TrackingController

_DEFAULT: Final = MpcOptions()


def tube_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: MpcOptions = _DEFAULT,
    *,
    design: TubeDesign,
) -> TrackingController:
    """Compose tube MPC after Mayne, Seron and Rakovic (2005), on the estimate (Mayne et al. 2006).

    The nominal error zbar follows the model under the MPC, within bounds that the tube has
    tightened, and with the disturbance s of the estimator; u_e = ubar + K (zhat - zbar). Membership
    is tested by half widths, in a box around the set. Where the deviation leaves that box, the
    nominal error restarts at the estimate, and the fallback of the tick says so.

    Raises:
        InvalidTube: see `ReferenceTube.along`.
    """
    design.require(vehicle, period_s)
    options = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)
    course = ExactCourse(reference, period_s, options.horizon)
    along = ReferenceTube.along(design, reference, len(course.feedforward))
    bounds = move_bounds(options, period_s, len(along.a), along.bounds)
    free = FreeInputs(FreeSteps.single(options.moves), bounds)
    horizon = CondensedHorizon(along.a, along.b, options, period_s, along.c, free)
    tube = along.tube
    rows = report_rows(tube.system.c)  # (T, 9, 7)
    gains = tube.system.gains  # (T, 3, 7)
    # States, trailer point and inputs of the deviation, each divided by its half width.
    trailer = tube.outputs[:, Output.TRAILER_ALONG :]
    widths = np.concatenate([tube.states, trailer, tube.inputs], axis=1)
    law = law_of(
        TUBE_MPC,
        course.grid.state,
        along.feedforward,
        course.vehicle,
        rows=len(along.feedforward),
        disturbances=1.0,
        gains=gains,
        faces=np.concatenate([rows, gains], axis=1) / widths[..., None],  # (T, 12, 7)
        half_widths=along.half_widths,
    )
    return course.controller(ArticulatedLaw(law, horizon, PredictedPath(course.grid)))
