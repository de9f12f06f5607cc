"""Tube along a reference, and the bounds that it leaves to the nominal input."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import reduce

import numpy as np

from ..errors import InvalidTube
from ..mpc.articulated_error import HITCH, error_dynamics, remaining_bounds
from ..mpc.condensing import StageBounds
from ..mpc.lmpc import HorizonTuning, stage_bounds
from ..reference.reference import Reference, exact_feedforward
from ..types import FloatArray, Input, State
from ..vehicle import OF_TOOL, CommandLimits, Vehicle
from .sets import DisturbanceSet
from .tube import TrackingSystem, Tube, feedback_gains, invariant_tube, reach_backwards, search_tube

_CROSS = (1, 3)  # cross-track errors among the outputs x_t, y_t, x_i, y_i
_BLOCK = 1024  # ticks at a time: a long reference needs little memory beside the result
_EVALUATIONS = 700  # of each simplex, at most
_START = (0.1, 2.5, 0.05, 2.5, 0.01, 0.01, 0.01, 0.01, 0.01, 0.3, 1.5, 0.9)  # weights
_HYDROSTAT_SHARE = 0.8  # largest share of the hydrostat's margin that the tube may take
# Largest share of the change in a period that the tube may take; the feedforward takes the rest
# where curves begin.
_RATE_SHARE = 0.9
_PENALTY = 3.0  # [m] for exceeding a margin by 100 %
_SECONDARY = 0.02  # weight of the other half widths beside the largest cross-track one


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
        if len(flat) != len(_START) or not (np.isfinite(flat).all() and (flat > 0.0).all()):
            raise InvalidTube(f"weights: got {flat.tolist()}, must be {len(_START)} above 0")

    @property
    def flat(self) -> FloatArray:
        """Return all weights in the order of the fields, (12,)."""
        return np.array([*self.outputs, *self.states, *self.inputs])

    @classmethod
    def of(cls, flat: FloatArray) -> AncillaryWeights:
        """Return the weights from `flat` (12,), the reverse of `AncillaryWeights.flat`."""
        values = [float(value) for value in flat]
        return cls(tuple(values[:4]), tuple(values[4:9]), tuple(values[9:]))  # pyright: ignore


def gain_schedule(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> FloatArray:
    """Return K (T, m, n) of u = K z at every tick, see `feedback_gains`; C is (T, p, n).

    Raises:
        InvalidTube: no gain stabilises the last stage.
    """
    outputs, states = np.array(weights.outputs), np.diag([0.0, 0.0, *weights.states])
    cost = c.transpose(0, 2, 1) @ (outputs[:, None] * c) + states  # (T, n, n)
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
    change in a period. A (T, n, n), B and C hold one motion each. The search starts at the weights
    of the shipped tubes.

    Raises:
        InvalidTube: no weights give a tube.
    """
    amplitudes = np.minimum(limits.upper - feedforward, feedforward - limits.lower) - reserve
    amplitudes[:, Input.HP] *= _HYDROSTAT_SHARE
    amplitudes = np.maximum(amplitudes, 1e-3)

    def system_of(flat: FloatArray) -> TrackingSystem:
        weights = AncillaryWeights.of(flat)
        motions = [slice(k, k + 1) for k in range(len(a))]
        gains = [gain_schedule(a[motion], b[motion], c[motion], weights) for motion in motions]
        return TrackingSystem(a, b, c, np.concatenate(gains), np.arange(len(a)))

    def cost(candidate: Tube) -> float:
        outputs = candidate.outputs
        cross = outputs[:, _CROSS]
        amplitude = np.maximum(candidate.inputs / amplitudes - 1.0, 0.0).sum()
        rate = np.maximum(candidate.rates / (_RATE_SHARE * limits.step) - 1.0, 0.0).sum()
        others = _SECONDARY * cross.sum() + _SECONDARY * outputs.max()
        return float(cross.max() + _PENALTY * (amplitude + rate) + others)

    start = np.array(_START)
    return AncillaryWeights.of(search_tube(system_of, cost, disturbance, start, _EVALUATIONS))


_N = len(State)
_DEGREES = math.degrees(1.0)


@dataclass(frozen=True)
class TubeDesign:
    """Data of a tube, valid along any reference of its vehicle."""

    vehicle: Vehicle
    period_s: float
    disturbance: DisturbanceSet  # of a step: error of the estimate less its prediction
    estimate_error: DisturbanceSet  # true error less the estimated one
    weights: AncillaryWeights  # of the ancillary gain

    def differing(self, vehicle: Vehicle, period_s: float) -> str:
        """Return the values that differ from the design's, as a text; empty where none does."""
        pairs = [("period_s", self.period_s, period_s)]
        for item in fields(Vehicle):
            if item.name not in OF_TOOL:
                given = getattr(vehicle, item.name)
                pairs.append((item.name, getattr(self.vehicle, item.name), given))
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
    """The tube of a design at T control ticks of a reference."""

    vehicle: Vehicle
    a: FloatArray  # (T, 16, 16) error dynamics with disturbances, see `error_dynamics`
    b: FloatArray  # (T, 16, 3)
    c: FloatArray  # (T + 1, 4, 16)
    feedforward: FloatArray  # (T, 3) u_r
    tube: Tube  # of the deviation of the estimated error from the nominal one
    half_widths: FloatArray  # (T, 9) of the true error's deviation, rows as in `report_rows`
    bounds: StageBounds  # of the nominal input u_e = u_r - u

    @classmethod
    def along(cls, design: TubeDesign, reference: Reference, ticks: int) -> ReferenceTube:
        """Return the tube of `design` at the first `ticks` of the reference.

        Raises:
            InvalidTube: the design is for another vehicle, the tube does not contract, or it needs
                more of an input than the limits leave; with the numbers.
        """
        period_s = design.period_s
        design.require(reference.vehicle, period_s)
        feedforward = exact_feedforward(reference, ticks, period_s)
        a, b, c = error_dynamics(reference, period_s, ticks)
        system = tracking_system(a, b, c, design.weights)
        tube = invariant_tube(system, design.disturbance)
        rows = report_rows(system.c)
        of_estimate = design.estimate_error.support(rows.reshape(-1, _N)).reshape(rows.shape[:2])
        _require_motion(reference, tube, period_s)
        bounds = remaining_bounds(feedforward, CommandLimits.of(reference.vehicle, period_s))
        return cls(
            vehicle=reference.vehicle,
            a=a,
            b=b,
            c=c,
            feedforward=feedforward,
            tube=tube,
            half_widths=np.concatenate([tube.states, tube.outputs[:, 2:]], axis=1) + of_estimate,
            bounds=tightened(bounds, tube.inputs, tube.rates, period_s),
        )

    @property
    def free_share(self) -> FloatArray:
        """Return the share of each input's range that feedforward and tube leave free, (T, 3).

        The range is from the middle to a stop for a steering angle, and from 0 to 1 for the
        hydrostat. Free is the distance from feedforward plus tube to the nearer limit.
        """
        low, high = self.vehicle.input_min, self.vehicle.input_max
        margin = np.minimum(high - self.feedforward, self.feedforward - low)
        return (margin - self.tube.inputs) / high


def tracking_system(
    a: FloatArray, b: FloatArray, c: FloatArray, weights: AncillaryWeights
) -> TrackingSystem:
    """Return the closed dynamics of the minimal state, from A, B and C of `error_dynamics`.

    Raises:
        InvalidTube: no gain minimises the cost of `weights`.
    """
    a, b, c = a[:, :_N, :_N], b[:, :_N], c[: len(a), :, :_N]
    return TrackingSystem.along(a, b, gain_schedule(a, b, c, weights), c)


def report_rows(outputs: FloatArray) -> FloatArray:
    """Return the matrices from an error z_e (7,) to the nine entries of a `TubeReport`, (T, 9, 7).

    `outputs` are C (T, 4, 7) of the error dynamics; the first two of them are states.
    """
    unit = np.tile(np.eye(_N), (len(outputs), 1, 1))
    return np.concatenate([unit, outputs[:, 2:]], axis=1)


def tightened(
    bounds: StageBounds, inputs: FloatArray, rates: FloatArray, period_s: float
) -> StageBounds:
    """Return `bounds` less the half widths of a tube in `inputs` and their `rates`, (T, m) each.

    Raises:
        InvalidTube: the difference is empty in an input or its change; with input, time and both
            half widths.
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
    k, item = np.unravel_index(int(np.argmax(share)), share.shape)
    half_width = float(needed[k, item])
    available = half_width - 0.5 * float(missing[k, item])
    scale, unit = (100.0, "%") if item == Input.HP else (_DEGREES, "deg")
    raise InvalidTube(
        f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
        f"+-{scale * half_width:.2f} {unit} of the {quantity}{Input(int(item)).name.lower()}, "
        f"where +-{scale * available:.2f} {unit} are available"
    )


def _require_motion(reference: Reference, tube: Tube, period_s: float) -> None:
    """Refuse a tube in which the vehicle may stand still, where the model has no course.

    The other states need no constraint of their own: the steering angles and the speed follow
    their commands with a lag of first order, and stay inside the limits that the commands keep.
    """
    speed = np.abs(reference.at(np.arange(len(tube.states)) * period_s).state[:, State.V])
    least = speed - tube.states[:, State.V]
    k = int(np.argmin(least))
    if least[k] <= 0.0:
        raise InvalidTube(
            f"the tightened set is empty: {k * period_s:.1f} s into the reference the tube takes "
            f"+-{tube.states[k, State.V]:.2f} m/s of a speed of {speed[k]:.2f} m/s"
        )


# Largest share of an input's distance to its limit that is reserved, assumed: the plan keeps the
# rest, so that the reference stays inside the bounds wherever it is inside the limits.
_MOST_RESERVED = 0.97
# Largest share of an input's change in a period that the ancillary gain may take, assumed.
_MOST_OF_RATE = 0.5
_LARGEST_WEIGHT = 1e6  # of an input, at which the search ends: a smaller gain leaves no more


@dataclass(frozen=True)
class GrowingTube:
    """Ancillary gain, and the share of the inputs that it has at each stage of the horizon.

    Where the limits leave less than K S_j, the ancillary action saturates at what they leave.
    """

    gains: FloatArray  # K (T, m, n)
    reserve: FloatArray  # (Np, T, m) of the input at stage j, by the tick at which the stage lies
    bounds: StageBounds  # of the free stages of every tick, (ticks, m Nc)
    # Largest deviation of the true hitch angle from the plan's at stage j, (Np,) [rad]: that of the
    # estimate, and its error
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

        A, B and C are those of `error_dynamics`; `tuning` gives horizon and bounds of the MPC.

        Raises:
            InvalidTube: no gain minimises the cost of the design's weights.
        """
        limits = CommandLimits.of(design.vehicle, design.period_s)
        system, inputs, rates, hitch = steered_system(design, a, b, c, limits, tuning.horizon)
        free = stage_bounds(tuning, design.period_s, len(a), remaining_bounds(feedforward, limits))
        reserve = np.minimum(inputs, _reservable(free.lower, free.upper))
        of_rates = np.minimum(rates, _reservable(free.step_lower, free.step_upper))
        spread = hitch.max(axis=1) + design.estimate_error.support(HITCH[None])
        gains = system.gains
        del system, inputs, rates, hitch  # large along a long reference
        bounds = horizon_bounds(free, reserve, of_rates, tuning.moves)
        return cls(gains, reserve, bounds, spread)


def steered_system(
    design: TubeDesign,
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    limits: CommandLimits,
    horizon: int,
) -> tuple[TrackingSystem, FloatArray, FloatArray, FloatArray]:
    """Return the closed loop of the ancillary gain, and `reachable_inputs` of it.

    A tube that ends with the horizon needs no gain that contracts, so that the gain can leave the
    plan more of the inputs than that of an invariant tube does:

    - The hydrostat has no ancillary action. It would keep to the place along the path, on which
      there is no constraint.
    - The steering keeps to the path with the design's weights, those of an input doubled until it
      leaves the plan half of its change in a period (`_MOST_OF_RATE`).

    A, B and C are those of `error_dynamics`.
    """
    weights, most = design.weights, _MOST_OF_RATE * limits.step
    while True:
        full = tracking_system(a, b, c, weights)
        gains = full.gains.copy()
        gains[:, Input.HP] = 0.0
        system = replace(full, gains=gains)
        inputs, rates, hitch = reachable_inputs(system, design.disturbance, horizon)
        factors = np.where(rates.max(axis=(0, 1)) > most, 2.0, 1.0)
        if np.all(factors == 1.0) or max(weights.inputs) > _LARGEST_WEIGHT:
            return system, inputs, rates, hitch
        weights = AncillaryWeights.of(weights.flat * np.append(np.ones(9), factors))


def _reservable(lower: FloatArray, upper: FloatArray) -> FloatArray:
    return _MOST_RESERVED * np.maximum(np.minimum(-lower, upper), 0.0)


def reachable_inputs(
    system: TrackingSystem, disturbance: DisturbanceSet, horizon: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the half widths of K m, of its change in a period, and of the hitch angle's deviation.

    They are (horizon, T, m), twice, and (horizon, T). Entry (j, k) is for the deviation m(k) that
    was 0 at tick k - j. Blocks of N steps, counted back from tick k, each have bounded energy, see
    `DisturbanceSet`.
    """
    gains, m = system.gains, system.gains.shape[1]
    hitch = np.broadcast_to(HITCH, (len(gains), 1, _N))
    rows = np.concatenate([gains, hitch, gains], axis=1)  # on m(k): inputs, hitch, rates
    half = np.zeros((horizon, *rows.shape[:2]))
    for first in range(0, len(gains), _BLOCK):
        at = np.arange(first, min(first + _BLOCK, len(gains)))
        backwards = reach_backwards(system, disturbance, at, rows[at], rates=slice(m + 1, None))
        for j, reach in zip(range(1, horizon), backwards, strict=False):
            half[j, at] = reach.completed + disturbance.reach(reach.energy)
    return half[..., :m], half[..., m + 1 :], half[..., m]


def horizon_bounds(
    free: StageBounds, reserve: FloatArray, of_rates: FloatArray, moves: int
) -> StageBounds:
    """Return the bounds on the free stages of every tick, (ticks, m Nc).

    Stage j of tick k is bounded by `free` at tick k + j less the reserve of stage j. The last free
    input is held to the horizon's end and satisfies the bounds of all stages that it is held for.

    The first input is bounded further, to the set V_k from which inputs of all later ticks exist:
    the viability kernel (Aubin 1991) of the inputs, an interval for each of them,

        V_k = { u : a plan of tick k starts with u, and some u' in V_{k+1} is within a step of u }.

    The constraints are those of the inputs, so that no state enters. Therefore, after a first input
    in V_0, every QP is feasible, whatever the disturbances. It contains 0 where all bounds do.

    `free` are the bounds without a tube, (T, m) each, `reserve` and `of_rates` (Np, T, m) what the
    tube takes of the inputs and their changes, `moves` the free stages Nc.
    """
    horizon, stages, _ = reserve.shape
    ticks = stages - horizon + 1

    def at(values: FloatArray, less: FloatArray, stage: int) -> FloatArray:
        window = slice(stage, stage + ticks)
        return values[window] + less[stage, window]

    first, held, taken = range(moves - 1), range(moves - 1, horizon), -reserve
    low = reduce(np.maximum, (at(free.lower, reserve, j) for j in held))
    high = reduce(np.minimum, (at(free.upper, taken, j) for j in held))
    lower = [*(at(free.lower, reserve, j) for j in first), low]
    upper = [*(at(free.upper, taken, j) for j in first), high]
    step_lower = [at(free.step_lower, of_rates, j) for j in range(moves)]
    step_upper = [at(free.step_upper, -of_rates, j) for j in range(moves)]
    for j in range(moves - 2, -1, -1):  # the inputs of stage j from which the plan can go on
        low = np.maximum(lower[j], low - step_upper[j + 1])
        high = np.minimum(upper[j], high - step_lower[j + 1])
    for k in range(ticks - 2, -1, -1):
        low[k] = np.maximum(low[k], low[k + 1] - step_upper[0][k + 1])
        high[k] = np.minimum(high[k], high[k + 1] - step_lower[0][k + 1])
        beyond = low[k] > high[k]  # the reference asks for more than the limits: no later plan
        low[k], high[k] = (
            np.where(beyond, lower[0][k], low[k]),
            np.where(beyond, upper[0][k], high[k]),
        )
    lower[0], upper[0] = low, high
    return StageBounds(
        lower=np.stack(lower[:moves], axis=1).reshape(ticks, -1),
        upper=np.stack(upper[:moves], axis=1).reshape(ticks, -1),
        step_lower=np.stack(step_lower, axis=1).reshape(ticks, -1),
        step_upper=np.stack(step_upper, axis=1).reshape(ticks, -1),
    )
