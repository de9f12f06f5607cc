"""Tube MPC with an ancillary gain: `ttempc-tube`."""

from dataclasses import dataclass

import numpy as np

from ..mpc.articulated_error import PredictedPath
from ..mpc.lmpc import CondensedHorizon
from ..reference.reference import Reference, ReferenceSample
from ..tube.reference_tube import ReferenceTube, TubeDesign, report_rows
from ..types import FloatArray
from ..vehicle import Vehicle
from .articulated_law import TUBE_MPC, ArticulatedLaw, law_of
from .articulated_mpc import MpcOptions
from .tracking_controller import TrackingController, around_exact_feedforward


@dataclass(frozen=True)
class TubeMpcOptions(MpcOptions):
    """Options of `ttempc-tube`: those of its nominal MPC. The tube has a file of its own."""


def tube_law(
    grid: ReferenceSample, along: ReferenceTube, horizon: CondensedHorizon
) -> ArticulatedLaw:
    """Tube MPC after Mayne, Seron and Rakovic (2005), on the estimate (Mayne et al. 2006).

    The nominal error zbar follows the model under the MPC, within bounds that the tube has
    tightened, and with the disturbance s of the estimator:

        zbar(k+1) = A zbar(k) + B ubar(k) - E s(k),   u_e = ubar + K (zhat - zbar).

    The deviation zhat - zbar of the estimate then obeys A + B K under the disturbance of each step,
    and stays in the tube as long as the windows of that disturbance stay in their set. The nominal
    error depends on no estimate of the state: noise reaches the commands through K only. The
    constraints are those of the inputs at the free stages, and the reference satisfies them: every
    tick has a solution, and no terminal set is needed. Stability with active constraints is not
    proven. Membership is tested by half widths, in a box around the set. Where the deviation leaves
    that box, as after a push or on ground unlike that of the
    data, the nominal error restarts at the estimate, and the fallback of the tick says so.
    """
    tube = along.tube
    rows, gains = report_rows(tube.system.c), tube.system.gains  # (T, 9, 7), (T, 3, 7)
    # States, trailer point and inputs of the deviation, each divided by its half width.
    widths = np.concatenate([tube.states, tube.outputs[:, 2:], tube.inputs], axis=1)
    faces = np.concatenate([rows, gains], axis=1) / widths[..., None]  # (T, 12, 7)
    law = law_of(
        TUBE_MPC,
        grid.state,
        along.feedforward,
        along.vehicle,
        disturbances=1.0,
        gains=gains,
        faces=faces,
        rows=rows,
        half_widths=along.half_widths,
    )
    return ArticulatedLaw(law, horizon, PredictedPath(grid))


def tube_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: TubeMpcOptions = TubeMpcOptions(),
    *,
    design: TubeDesign,
) -> TrackingController:
    """Compose feedforward, nominal MPC and ancillary gain of `design`: `ttempc-tube`.

    Raises:
        InvalidTube: see `ReferenceTube.along`.
    """
    design.require(vehicle, period_s)
    options = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)

    def law(grid: ReferenceSample, feedforward: FloatArray) -> ArticulatedLaw:
        along = ReferenceTube.along(design, reference, len(feedforward))
        horizon = CondensedHorizon(along.a, along.b, options, period_s, along.c, along.bounds)
        return tube_law(grid, along, horizon)

    return around_exact_feedforward(vehicle, reference, period_s, options.horizon, law)
