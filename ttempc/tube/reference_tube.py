"""Tube along a reference, and the bounds that it leaves to the nominal input.

A `TubeDesign` holds the data of a tube. `ReferenceTube` is the invariant tube of a design along a
reference, for the controller `ttempc-tube`. `GrowingTube` grows from the estimate over the horizon
of the controller `ttempc`. States and inputs are errors z_e and u_e of `error_dynamics`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import reduce
from typing import Final, NamedTuple

import numpy as np

from ..errors import InvalidTube
from ..mpc.articulated_error import HITCH, error_dynamics, remaining_bounds
from ..mpc.condensing import StageBounds
from ..mpc.lmpc import HorizonTuning, stage_bounds
from ..reference.reference import Reference, exact_feedforward
from ..types import FloatArray, Input, State
from ..vehicle import OUTSIDE_TUBES, CommandLimits, Vehicle
from .sets import DisturbanceSet
from .tube import TrackingSystem, Tube, feedback_gains, invariant_tube, reach_backwards, search_tube

_STATES: Final = len(State)
_OUTPUTS: Final = 4  # x_t, y_t, x_i, y_i
_CROSS_TRACK: Final = (1, 3)  # y_t and y_i among the outputs
_WEIGHTS: Final = _OUTPUTS + 5 + len(Input)  # of outputs, of the states after x and y, of inputs
_DEGREES: Final = math.degrees(1.0)
_PERCENT: Final = 100.0

# Search of the weights.
_START: Final = (0.1, 2.5, 0.05, 2.5, 0.01, 0.01, 0.01, 0.01, 0.01, 0.3, 1.5, 0.9)
_EVALUATIONS = 700  # of each simplex, at most
_LEAST_AMPLITUDE: Final = 1e-3  # [rad] or fraction: of a margin that is used up
_HYDROSTAT_SHARE: Final = 0.8  # largest share of the hydrostat's margin that the tube may take
# Largest share of the change in a period that the tube may take; the feedforward takes the rest
# where curves begin.
_RATE_SHARE: Final = 0.9
_PENALTY: Final = 3.0  # [m] for exceeding a margin by 100 %
_SECONDARY: Final = 0.02  # weight of the other half widths beside the largest cross-track one

# Growing tube.
_BLOCK: Final = 1024  # ticks at a time, so that a long reference needs little memory
# Largest share of an input's distance to its limit that is reserved, assumed: the plan keeps the
# rest, so that the reference stays inside the bounds wherever it is inside the limits.
_MOST_RESERVED: Final = 0.97
# Largest share of an input's change in a period that the ancillary gain may take, assumed.
_MOST_OF_RATE: Final = 0.5
# Weight of an input at which the search ends: a smaller gain leaves no more.
_LARGEST_WEIGHT: Final = 1e6


@dataclass(frozen=True, slots=True)
class AncillaryWeights:
    """Diagonals of the quadratic cost that the ancillary gain minimises.

    Raises:
        InvalidTube: a weight is not finite or not above 0.
    """

    outputs: tuple[float, float, float, float]  # x, y of tractor and trailer in their frames
    states: tuple[float, float, float, float, float]  # psi_t, psi_i, delta_t, delta_i, v
    inputs: tuple[float, float, float]  # delta_t, delta_i, hp

    def __post_init__(self) -> None:
        flat = self.flat
        positive = bool(np.isfinite(flat).all() and (flat > 0.0).all())
        if len(flat) != _WEIGHTS or not positive:
            raise InvalidTube(f"weights: got {flat.tolist()}, must be {_WEIGHTS} above 0")

    @property
    def flat(self) -> FloatArray:
        """All weights in the order of the fields, (12,)."""
        return np.array([*self.outputs, *self.states, *self.inputs])

    @classmethod
    def of(cls, flat: FloatArray) -> AncillaryWeights:
        """Return the weights from `flat` (12,), the inverse of `AncillaryWeights.flat`."""
        values = [float(value) for value in flat]
        outputs = tuple(values[:_OUTPUTS])
        states = tuple(values[_OUTPUTS : -len(Input)])
        inputs = tuple(values[-len(Input) :])
        return cls(outputs, states, inputs)  # pyright: ignore[reportArgumentType]


def gain_schedule(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> FloatArray:
    """Return the gains K (T, m, n) of u = K z at every tick, see `feedback_gains`.

    A is (T, n, n), B (T, n, m), C (T, p, n). The cost of a state is Q = C'Q_y C + Q_z.

    Raises:
        InvalidTube: no gain stabilises the last stage.
    """
    of_outputs = np.array(weights.outputs)  # diagonal of Q_y
    of_states = np.diag([0.0, 0.0, *weights.states])  # Q_z: x and y are outputs
    cost = c.transpose(0, 2, 1) @ (of_outputs[:, None] * c) + of_states  # (T, n, n)
    try:
        return feedback_gains(a, b, cost, np.array(weights.inputs))
    except InvalidTube as reason:
        raise InvalidTube(f"no ancillary gain minimises {weights}: {reason}") from None


def search_weights(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    disturbance: DisturbanceSet,
    feedforward: FloatArray,
    limits: CommandLimits,
    reserve: FloatArray,
) -> AncillaryWeights:
    """Return weights whose tube is narrow across the track, at T stationary motions.

    `search_tube` minimises the largest cross-track half width of the two axle points. The other
    half widths enter with a small weight. Penalties keep free the `reserve` (m,) of each input, a
    fifth of the hydrostat's margin between feedforward (T, m) and limits, and a tenth of every
    change in a period. A (T, n, n), B and C hold one motion each. The search starts near the
    weights of the shipped tubes.

    Raises:
        InvalidTube: no weights give a tube.
    """
    # Half width of each input that a tube may take without a penalty, (T, m).
    margins = np.minimum(limits.upper - feedforward, feedforward - limits.lower)
    amplitudes = margins - reserve
    amplitudes[:, Input.HP] *= _HYDROSTAT_SHARE
    amplitudes = np.maximum(amplitudes, _LEAST_AMPLITUDE)
    rates = _RATE_SHARE * limits.step

    motions = [slice(index, index + 1) for index in range(len(a))]

    def system_of(flat: FloatArray) -> TrackingSystem:
        """Return the closed loop of some weights; each stationary motion precedes itself."""
        weights = AncillaryWeights.of(flat)
        gains = [gain_schedule(a[motion], b[motion], c[motion], weights) for motion in motions]
        return TrackingSystem(a, b, c, np.concatenate(gains), np.arange(len(a)))

    def cost(candidate: Tube) -> float:
        """Return the cost of a tube [m]."""
        half_widths = candidate.outputs
        cross_track = half_widths[:, _CROSS_TRACK]
        amplitude_excess = np.maximum(candidate.inputs / amplitudes - 1.0, 0.0).sum()
        rate_excess = np.maximum(candidate.rates / rates - 1.0, 0.0).sum()
        penalty = _PENALTY * (amplitude_excess + rate_excess)
        others = _SECONDARY * cross_track.sum() + _SECONDARY * half_widths.max()
        return float(cross_track.max() + penalty + others)

    start = np.array(_START)
    return AncillaryWeights.of(search_tube(system_of, cost, disturbance, start, _EVALUATIONS))


@dataclass(frozen=True)
class TubeDesign:
    """Data of a tube. They are valid along any reference of its vehicle."""

    vehicle: Vehicle
    period_s: float
    disturbance: DisturbanceSet  # estimated error z_e less its prediction, of each step
    estimate_error: DisturbanceSet  # true error z_e less the estimated one
    weights: AncillaryWeights  # of the cost that the ancillary gain minimises

    def differing(self, vehicle: Vehicle, period_s: float) -> str:
        """Return the values that differ from the design's, as a text; empty where none does.

        `OUTSIDE_TUBES` are not compared: a tube file may leave them out.
        """
        pairs = [("period_s", self.period_s, period_s)]
        for item in fields(Vehicle):
            if item.name not in OUTSIDE_TUBES:
                designed = getattr(self.vehicle, item.name)
                given = getattr(vehicle, item.name)
                pairs.append((item.name, designed, given))

        return ", ".join(
            f"{name} {designed:.6g} (here {given:.6g})"
            for name, designed, given in pairs
            if not math.isclose(designed, given, rel_tol=1e-6, abs_tol=1e-12)
        )

    def require(self, vehicle: Vehicle, period_s: float) -> None:
        """Refuse a vehicle or control period other than the design's.

        Raises:
            InvalidTube: with the values that differ.
        """
        if differing := self.differing(vehicle, period_s):
            raise InvalidTube(f"the tube was made for another vehicle: {differing}")


@dataclass(frozen=True)
class ReferenceTube:
    """The invariant tube of a design at T control ticks of a reference."""

    vehicle: Vehicle
    a: FloatArray  # (T, 16, 16) error dynamics with disturbances, see `error_dynamics`
    b: FloatArray  # (T, 16, 3)
    c: FloatArray  # (T + 1, 4, 16)
    feedforward: FloatArray  # u_r, (T, 3)
    tube: Tube  # of the deviation of the estimated error from the nominal one
    half_widths: FloatArray  # (T, 9) of the true error's deviation, columns as in `TubeReport`
    bounds: StageBounds  # of the nominal input u_e = u_r - u

    @classmethod
    def along(cls, design: TubeDesign, reference: Reference, ticks: int) -> ReferenceTube:
        """Return the tube of `design` at the first `ticks` of the reference.

        Raises:
            InvalidTube: the design is for another vehicle, the tube does not contract, or it needs
                more of an input than the limits leave; with the numbers.
        """
        vehicle = reference.vehicle
        period_s = design.period_s
        design.require(vehicle, period_s)

        # Deviation of the estimated error from the nominal one.
        a, b, c = error_dynamics(reference, period_s, ticks)
        system = tracking_system(a, b, c, design.weights)
        tube = invariant_tube(system, design.disturbance)
        _require_motion(reference, tube, period_s)

        # Deviation of the true error from the nominal one: the error of the estimate is added.
        rows = report_rows(system.c)
        of_tube = np.concatenate([tube.states, tube.outputs[:, 2:]], axis=1)
        of_estimate = design.estimate_error.support(rows.reshape(-1, _STATES))

        # What the tube leaves to the nominal input.
        feedforward = exact_feedforward(reference, ticks, period_s)
        bounds = remaining_bounds(feedforward, CommandLimits.of(vehicle, period_s))
        return cls(
            vehicle=vehicle,
            a=a,
            b=b,
            c=c,
            feedforward=feedforward,
            tube=tube,
            half_widths=of_tube + of_estimate.reshape(rows.shape[:2]),
            bounds=tightened(bounds, tube.inputs, tube.rates, period_s),
        )

    @property
    def free_share(self) -> FloatArray:
        """Share of each input's range that feedforward and tube leave free, (T, 3).

        The range of a steering angle is from the middle to a stop, that of the hydrostat from 0 to
        1. The free part is the distance from feedforward and tube to the nearer limit.
        """
        lower = self.vehicle.input_min
        upper = self.vehicle.input_max
        margin = np.minimum(upper - self.feedforward, self.feedforward - lower)
        return (margin - self.tube.inputs) / upper


def tracking_system(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> TrackingSystem:
    """Return the closed loop of the error z_e (7,), without disturbances.

    A, B and C are those of `error_dynamics`. C of the tick after the last is left out.

    Raises:
        InvalidTube: no gain minimises the cost of `weights`.
    """
    ticks = len(a)
    a = a[:, :_STATES, :_STATES]
    b = b[:, :_STATES]
    c = c[:ticks, :, :_STATES]
    return TrackingSystem.along(a, b, gain_schedule(a, b, c, weights), c)


def report_rows(outputs: FloatArray) -> FloatArray:
    """Return the matrices from an error z_e (7,) to the nine entries of a `TubeReport`, (T, 9, 7).

    `outputs` are C (T, 4, 7) of the error dynamics. Its first two outputs are states.
    """
    unit = np.tile(np.eye(_STATES), (len(outputs), 1, 1))
    return np.concatenate([unit, outputs[:, 2:]], axis=1)


def tightened(
    bounds: StageBounds, inputs: FloatArray, rates: FloatArray, period_s: float
) -> StageBounds:
    """Return `bounds` less the half widths of a tube in `inputs` and their `rates`, (T, m) each.

    Raises:
        InvalidTube: nothing is left of an input or its change; the message gives the input, the
            time, the half width of the tube and the one that is available.
    """
    difference = StageBounds(
        lower=bounds.lower + inputs,
        upper=bounds.upper - inputs,
        step_lower=bounds.step_lower + rates,
        step_upper=bounds.step_upper - rates,
    )
    _require_width("", difference.lower, difference.upper, inputs, period_s)
    _require_width(
        "change in a period of ", difference.step_lower, difference.step_upper, rates, period_s
    )
    return difference


def _require_width(
    quantity: str, lower: FloatArray, upper: FloatArray, needed: FloatArray, period_s: float
) -> None:
    """Refuse tightened bounds that cross; the message names the worst in relation to `needed`."""
    missing = lower - upper
    if np.all(missing <= 0.0):
        return

    share = np.divide(missing, needed, out=np.full_like(missing, -np.inf), where=needed > 0.0)
    k, column = np.unravel_index(int(np.argmax(share)), share.shape)
    name = Input(int(column)).name.lower()
    half_width = float(needed[k, column])
    available = half_width - 0.5 * float(missing[k, column])
    if column == Input.HP:
        scale = _PERCENT
        unit = "%"
    else:
        scale = _DEGREES
        unit = "deg"
    raise InvalidTube(
        f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
        f"+-{scale * half_width:.2f} {unit} of the {quantity}{name}, "
        f"where +-{scale * available:.2f} {unit} are available"
    )


def _require_motion(reference: Reference, tube: Tube, period_s: float) -> None:
    """Refuse a tube in which the vehicle may stand still, where the model has no course.

    The other states need no constraint of their own: the steering angles and the speed follow
    their commands with a lag of first order, and stay inside the limits that the commands keep.
    """
    times_s = np.arange(len(tube.states)) * period_s
    speed = np.abs(reference.at(times_s).state[:, State.V])
    least = speed - tube.states[:, State.V]
    k = int(np.argmin(least))
    if least[k] <= 0.0:
        raise InvalidTube(
            f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
            f"+-{tube.states[k, State.V]:.2f} m/s of a speed of {speed[k]:.2f} m/s"
        )


@dataclass(frozen=True)
class GrowingTube:
    """Ancillary gain, and the part of the inputs reserved for it at each stage of the horizon.

    The deviation is 0 at the estimate and grows with the stage j. Where the limits leave less than
    K S_j, the ancillary action saturates at what they leave.
    """

    gains: FloatArray  # K (T, m, n)
    reserve: FloatArray  # (Np, T, m) half width of the action at stage j, by the stage's own tick
    bounds: StageBounds  # of the free stages of every tick, (ticks, m Nc)
    relaxed: StageBounds  # the same without a reserve of the trailer's steering
    # Largest deviation of the true hitch angle from the plan's at stage j, (Np,) [rad]. It is the
    # deviation of the estimated angle and the error of the estimate.
    hitch: FloatArray

    @classmethod
    def along(
        cls,
        design: TubeDesign,
        a: FloatArray,
        b: FloatArray,
        c: FloatArray,
        feedforward: FloatArray,
        tuning: HorizonTuning,
    ) -> GrowingTube:
        """Return the tube of `design` along a reference with the feedforward u_r (T, 3).

        A, B and C are those of `error_dynamics`. `tuning` gives horizon and bounds of the MPC.

        Raises:
            InvalidTube: no gain minimises the cost of the design's weights.
        """
        limits = CommandLimits.of(design.vehicle, design.period_s)
        system, reach = steered_system(design, a, b, c, limits, tuning.horizon)
        gains = system.gains

        # The ancillary action has at most a share of what the limits leave without a tube.
        without_tube = remaining_bounds(feedforward, limits)
        free = stage_bounds(tuning, design.period_s, len(a), without_tube)
        reserve = np.minimum(reach.inputs, _reservable(free.lower, free.upper))
        of_rates = np.minimum(reach.rates, _reservable(free.step_lower, free.step_upper))

        estimate_error = design.estimate_error.support(HITCH[None])
        hitch = reach.hitch.max(axis=1) + estimate_error
        del system, reach  # large along a long reference: freed before the bounds are computed

        bounds = horizon_bounds(free, reserve, of_rates, tuning.moves)
        of_others = reserve * np.where(np.arange(len(Input)) == Input.DELTA_I, 0.0, 1.0)
        relaxed = horizon_bounds(free, of_others, of_rates, tuning.moves)
        return cls(gains, reserve, bounds, relaxed, hitch)


def _reservable(lower: FloatArray, upper: FloatArray) -> FloatArray:
    """Return the largest half width that may be reserved between bounds around 0."""
    distance = np.minimum(-lower, upper)
    return _MOST_RESERVED * np.maximum(distance, 0.0)


class HorizonReach(NamedTuple):
    """Half widths at stage j and tick k, for the deviation m(k) that was 0 at tick k - j."""

    inputs: FloatArray  # (Np, T, m) of the ancillary action K m
    rates: FloatArray  # (Np, T, m) of its change in a period
    hitch: FloatArray  # (Np, T) of the deviation of the hitch angle [rad]


def steered_system(
    design: TubeDesign,
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    limits: CommandLimits,
    horizon: int,
) -> tuple[TrackingSystem, HorizonReach]:
    """Return the closed loop of the ancillary gain, and its reach over the horizon.

    A tube that ends with the horizon needs no gain that contracts. The gain can therefore leave
    more of the inputs to the plan than the gain of an invariant tube:

    - The hydrostat has no ancillary action. It would keep to the place along the path, on which
      there is no constraint.
    - The steering keeps to the path with the design's weights. The weight of an input is doubled
      until the gain leaves half of the change in a period to the plan (`_MOST_OF_RATE`).

    A, B and C are those of `error_dynamics`.
    """
    weights = design.weights
    allowed = _MOST_OF_RATE * limits.step
    while True:
        full = tracking_system(a, b, c, weights)
        gains = full.gains.copy()
        gains[:, Input.HP] = 0.0
        system = replace(full, gains=gains)
        reach = reachable_inputs(system, design.disturbance, horizon)

        too_fast = reach.rates.max(axis=(0, 1)) > allowed
        if not too_fast.any() or max(weights.inputs) > _LARGEST_WEIGHT:
            return system, reach
        flat = weights.flat
        flat[-len(Input) :] *= np.where(too_fast, 2.0, 1.0)
        weights = AncillaryWeights.of(flat)


def reachable_inputs(
    system: TrackingSystem, disturbance: DisturbanceSet, horizon: int
) -> HorizonReach:
    """Return the half widths of ancillary action and hitch angle over the horizon.

    Blocks of N steps, counted back from tick k, each have bounded energy, see `DisturbanceSet`.
    """
    gains = system.gains
    ticks, m, _ = gains.shape

    # Rows on m(k): inputs, hitch angle, rates.
    hitch = np.broadcast_to(HITCH, (ticks, 1, _STATES))
    rows = np.concatenate([gains, hitch, gains], axis=1)
    rates = slice(m + 1, None)

    half_widths = np.zeros((horizon, *rows.shape[:2]))
    for first in range(0, ticks, _BLOCK):
        block = np.arange(first, min(first + _BLOCK, ticks))
        backwards = reach_backwards(system, disturbance, block, rows[block], rates)
        for stage, reach in zip(range(1, horizon), backwards, strict=False):
            half_widths[stage, block] = reach.completed + disturbance.reach(reach.energy)

    return HorizonReach(
        inputs=half_widths[..., :m], rates=half_widths[..., rates], hitch=half_widths[..., m]
    )


def horizon_bounds(
    free: StageBounds, reserve: FloatArray, of_rates: FloatArray, moves: int
) -> StageBounds:
    """Return the bounds on the free stages of every tick, (ticks, m Nc).

    Stage j of tick k is bounded by `free` at tick k + j less the reserve of stage j. The last free
    input is held to the end of the horizon. It satisfies the bounds of every stage for which it is
    held.

    The first input is bounded further, to the set V_k from which inputs of all later ticks exist.
    V_k is the viability kernel (Aubin 1991) of the inputs, an interval for each of them,

        V_k = { u : a plan of tick k starts with u, and some u' in V_{k+1} is within a step of u }.

    The constraints are on the inputs alone, so that no state enters. Therefore, after a first input
    in V_0, every QP is feasible, whatever the disturbances. V_k contains 0 where all bounds do.

    Args:
        free: bounds without a tube, (T, m) each.
        reserve: half widths of the tube in the inputs, (Np, T, m).
        of_rates: half widths of the tube in the changes of the inputs, (Np, T, m).
        moves: number Nc of free stages.
    """
    horizon, stages, _ = reserve.shape
    ticks = stages - horizon + 1

    def at(values: FloatArray, less: FloatArray, stage: int) -> FloatArray:
        """Return the bound of a stage at every tick, (ticks, m)."""
        window = slice(stage, stage + ticks)
        return values[window] + less[stage, window]

    # Bounds of each free stage j, by ticks. The last one is held.
    held = range(moves - 1, horizon)
    lower = [at(free.lower, reserve, stage) for stage in range(moves - 1)]
    lower.append(reduce(np.maximum, (at(free.lower, reserve, stage) for stage in held)))
    upper = [at(free.upper, -reserve, stage) for stage in range(moves - 1)]
    upper.append(reduce(np.minimum, (at(free.upper, -reserve, stage) for stage in held)))
    step_lower = [at(free.step_lower, of_rates, stage) for stage in range(moves)]
    step_upper = [at(free.step_upper, -of_rates, stage) for stage in range(moves)]

    low, high = _viable_first_inputs(lower, upper, step_lower, step_upper)
    lower[0] = low
    upper[0] = high

    def stacked(bounds: list[FloatArray]) -> FloatArray:
        """Return the bounds of all free stages in one row for each tick, (ticks, m Nc)."""
        return np.stack(bounds, axis=1).reshape(ticks, -1)

    return StageBounds(
        lower=stacked(lower),
        upper=stacked(upper),
        step_lower=stacked(step_lower),
        step_upper=stacked(step_upper),
    )


def _viable_first_inputs(
    lower: list[FloatArray],
    upper: list[FloatArray],
    step_lower: list[FloatArray],
    step_upper: list[FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return the lower and the upper ends of V_k at every tick, (ticks, m) each.

    The arguments hold the bounds of each free stage, (ticks, m). `horizon_bounds` defines V_k.
    """
    # First inputs from which a plan reaches its last stage.
    low = lower[-1].copy()
    high = upper[-1].copy()
    for stage in range(len(lower) - 2, -1, -1):
        low = np.maximum(lower[stage], low - step_upper[stage + 1])
        high = np.minimum(upper[stage], high - step_lower[stage + 1])

    # First inputs from which the plans of all later ticks exist too. Where the reference requires
    # more than the limits, no later plan exists, and the bounds of the stage itself remain.
    for k in range(len(low) - 2, -1, -1):
        low[k] = np.maximum(low[k], low[k + 1] - step_upper[0][k + 1])
        high[k] = np.minimum(high[k], high[k + 1] - step_lower[0][k + 1])
        empty = low[k] > high[k]
        low[k] = np.where(empty, lower[0][k], low[k])
        high[k] = np.where(empty, upper[0][k], high[k])
    return low, high
