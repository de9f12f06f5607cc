"""Composition of the articulated MPC: `ttempc` and `ttempc-nominal`.

`ttempc` is an offset-free linear MPC on the articulated model in a growing tube, with a saturated
robust law; `ttempc-nominal` its MPC alone. `articulated_controller` is the list of their parts: the
soft bounds and the parts of the law are small objects in `ttempc.laws.parts`.
"""

from __future__ import annotations

import math
from typing import Final

from ..mpc.articulated_error import PredictedPath, remaining_bounds
from ..mpc.condensing import FreeInputs, FreeSteps
from ..mpc.lmpc import CondensedHorizon, OutputBounds, move_bounds
from ..reference.reference import ConstantSpeed, Reference, guided
from ..tube.reference_tube import GrowingTube, TubeDesign
from ..types import FloatArray
from ..vehicle import Vehicle
from .articulated_law import ArticulatedLaw
from .law_records import NOMINAL, ONE_STEP, law_of
from .near_stop import weight_factors
from .options import ArticulatedOptions, NominalOptions
from .parts import (
    BackupPlan,
    CorridorBound,
    CutInReverse,
    DampedApproach,
    Disturbances,
    ErrorModel,
    HitchBound,
    LawPart,
    RobustAction,
    SoftBound,
    StepMonitor,
)
from .tracking_controller import ExactCourse, TrackingController

_DEFAULT: Final = ArticulatedOptions()
_LAPS: Final = 3  # of which every one has its own tables
_SETTLED_S: Final = 80.0  # after the second lap, from whose end the gains are computed; assumed


def articulated_controller(
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    options: NominalOptions = _DEFAULT,
    design: TubeDesign | None = None,
) -> TrackingController:
    """Compose feedforward, MPC of the articulated model and robust law: the controller `ttempc`.

    `NominalOptions` have neither robust law nor tube; of `ArticulatedOptions` each is an option of
    its own. With a `design` the tube that grows from the estimate tightens the inputs of the MPC
    and backs up its last plan, and a monitor of the residual w of each step, which changes no
    command, reports whether w lies in the design's set W of single steps. The true error then lies
    in W widened by the error of the estimate. The margin is 1 less the gauge of w in W.

    Raises:
        InvalidTube: the design was made for another vehicle.
        InvalidTuning: no gain stabilises the last stage.
    """
    if design:
        design.require(vehicle, period_s)
    reference = guided(reference, options.guided)
    options = options.for_vehicle(vehicle, reference.speed.top_speed, period_s)
    course = ExactCourse(reference, period_s, options.horizon)
    lap = shared_lap(reference, period_s)
    ticks = min(len(course.feedforward), 2.0 * lap + _SETTLED_S / period_s)
    model = ErrorModel.along(course, int(ticks))
    tube = growing_tube(model, options, design)

    parts = law_parts(model, options, design, tube)
    fields: dict[str, FloatArray | float] = {}
    for part in parts:
        fields |= part.fields(model)
    law = law_of(
        ONE_STEP if any(part.needs_residual for part in parts) else NOMINAL,
        course.grid.state,
        course.feedforward,
        course.vehicle,
        rows=len(model.feedforward),
        **fields,
    )

    if tube:  # which tightens single periods
        free = FreeInputs(FreeSteps.single(options.moves), tube.bounds)
    else:
        steps = options.free_steps(period_s)
        remaining = remaining_bounds(model.feedforward, course.limits)
        bounds = move_bounds(options, period_s, len(model.a), remaining, steps)
        free = FreeInputs(steps, bounds)
    horizon = CondensedHorizon(
        model.changing_a,
        model.changing_b,
        options,
        period_s,
        outputs=model.c,
        free=free,
        soft=soft_bounds(model, options, tube),
        damped=DampedApproach(options.damping_s).outputs(model),
        weight_factors=weight_factors(course.reference, len(model.c), period_s),
    )
    relaxed = tube.relaxed if tube else None
    path = PredictedPath(course.grid)
    return course.controller(ArticulatedLaw(law, horizon, path, lap, relaxed))


def shared_lap(reference: Reference, period_s: float) -> float:
    """Return the ticks of a lap whose tables all later laps share; infinite where none does.

    Laps of a closed path at one speed share them: a place is off by half a tick at most.
    """
    path = reference.path
    speed = reference.speed
    if path.laps <= _LAPS or reference.corridor or not isinstance(speed, ConstantSpeed):
        return math.inf
    return path.lap_m / (speed.speed * period_s)


def growing_tube(
    model: ErrorModel, options: NominalOptions, design: TubeDesign | None
) -> GrowingTube | None:
    """Return the tube that the options ask for, None without a design."""
    if design is None or not (isinstance(options, ArticulatedOptions) and options.tube):
        return None
    return GrowingTube.along(design, model.a, model.b, model.c, model.feedforward, options)


def law_parts(
    model: ErrorModel,
    options: NominalOptions,
    design: TubeDesign | None,
    tube: GrowingTube | None,
) -> list[LawPart]:
    """Return the parts of the law that the options ask for."""
    parts: list[LawPart] = [Disturbances(options.disturbances)]
    if model.vehicle.reverse and options.damping_s > 0.0:
        parts.append(CutInReverse(options.damping_s))
    if not isinstance(options, ArticulatedOptions):
        return parts
    if options.robust:
        parts.append(RobustAction(options.saturation, options.input_weight, options.memory_s))
    if tube:
        parts.append(BackupPlan(tube))
    if design:
        parts.append(StepMonitor(design))
    return parts


def soft_bounds(
    model: ErrorModel, options: NominalOptions, tube: GrowingTube | None
) -> OutputBounds:
    """Return the soft bounds that options and reference ask for, one beside the other."""
    limit = math.radians(options.hitch_limit_deg)
    corridor = model.reference.corridor if options.corridor else None
    if corridor and corridor.hitch_limit is not None:
        corridor.require_hitch(model.grid.hitch_angle)
        limit = min(limit, corridor.hitch_limit)
    chosen: list[SoftBound] = [HitchBound(limit, tube)]
    if corridor:
        chosen.append(CorridorBound(corridor))
    first, *others = (bound.bounds(model, options) for bound in chosen)
    for other in others:
        first = first.beside(other)
    return first
