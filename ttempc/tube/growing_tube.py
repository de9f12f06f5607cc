"""Tube that grows from the estimate over the horizon, and the bounds that it leaves to the inputs.

The nominal state of a tick starts at the estimate, so that the deviation m is 0 at stage 0. Under
u_e = ubar + K m and the disturbances of later steps, m at stage j lies in the reachable set S_j,
and the planned input of that stage is tightened by K S_j (Chisci, Rossiter and Zappa 2001). The
first input is not tightened: nothing about it is uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..limits import CommandLimits
from ..mpc.articulated_error import remaining_bounds
from ..mpc.qp import HorizonTuning, StageBounds, stage_bounds
from ..types import FloatArray, Input
from .disturbance_set import DisturbanceSet
from .reference_tube import TubeDesign, tracking_system
from .tube import TrackingSystem, reach_backwards

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
        """Return the tube of `design` along a reference.

        Args:
            design: gives disturbance set, ancillary gain, vehicle and period.
            a: A (T, 16, 16), b: B (T, 16, 3), c: C (T + 1, 4, 16) of `error_dynamics`.
            b: see a.
            c: see a.
            feedforward: u_r (T, 3).
            tuning: horizon and bounds of the MPC.

        Raises:
            InvalidTube: no gain minimises the cost of the design's weights.
        """
        limits = CommandLimits.of(design.vehicle, design.period_s)
        system, inputs, rates = steered_system(design, a, b, c, limits, tuning.horizon)
        free = stage_bounds(tuning, design.period_s, len(a), remaining_bounds(feedforward, limits))
        reserve = np.minimum(inputs, _reservable(free.lower, free.upper))
        of_rates = np.minimum(rates, _reservable(free.step_lower, free.step_upper))
        bounds = horizon_bounds(free, reserve, of_rates, tuning.moves)
        return cls(system.gains, reserve, bounds)


def steered_system(
    design: TubeDesign,
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    limits: CommandLimits,
    horizon: int,
) -> tuple[TrackingSystem, FloatArray, FloatArray]:
    """Return the closed loop of the ancillary gain, and `reachable_inputs` of it.

    A tube that ends with the horizon needs no gain that contracts, so that the gain can leave the
    plan more of the inputs than that of an invariant tube does:

    - The hydrostat has no ancillary action. It would keep to the place along the path, on which
      there is no constraint.
    - The steering keeps to the path with the design's weights, those of an input doubled until it
      leaves the plan half of its change in a period (`_MOST_OF_RATE`).

    Args:
        design: gives weights and disturbance set.
        a: A (T, 16, 16), b: B (T, 16, 3), c: C (T + 1, 4, 16) of `error_dynamics`.
        b: see a.
        c: see a.
        limits: of the inputs.
        horizon: Np.
    """
    weights, most = design.weights, _MOST_OF_RATE * limits.step
    while True:
        full = tracking_system(a, b, c, weights)
        gains = full.gains.copy()
        gains[:, Input.HP] = 0.0
        system = replace(full, gains=gains)
        inputs, rates = reachable_inputs(system, design.disturbance, horizon)
        factors = np.where(rates.max(axis=(0, 1)) > most, 2.0, 1.0)
        if np.all(factors == 1.0) or max(weights.inputs) > _LARGEST_WEIGHT:
            return system, inputs, rates
        weights = weights.with_inputs_times(factors)


def _reservable(lower: FloatArray, upper: FloatArray) -> FloatArray:
    return _MOST_RESERVED * np.maximum(np.minimum(-lower, upper), 0.0)


def reachable_inputs(
    system: TrackingSystem, disturbance: DisturbanceSet, horizon: int
) -> tuple[FloatArray, FloatArray]:
    """Return the half widths of K m and of its change in a period, (horizon, T, m) each.

    Entry (j, k) is for the deviation m(k) that was 0 at tick k - j. Blocks of N steps, counted back
    from tick k, each have bounded energy, see `DisturbanceSet`.
    """
    gains, m = system.gains, system.gains.shape[1]
    rows = np.concatenate([gains, gains], axis=1)  # on m(k): inputs, rates
    half = np.zeros((horizon, *rows.shape[:2]))
    backwards = reach_backwards(
        system, disturbance, np.arange(len(gains)), rows, rates=slice(m, None)
    )
    for j, (completed, energy, _) in zip(range(1, horizon), backwards, strict=False):
        half[j] = completed + disturbance.reach(energy)
    return half[..., :m], half[..., m:]


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

    Args:
        free: bounds on the input and its change without a tube, (T, m) each.
        reserve: (Np, T, m) of the inputs.
        of_rates: (Np, T, m) of their changes.
        moves: Nc, free stages.
    """
    horizon, stages, _ = reserve.shape
    ticks = stages - horizon + 1

    def at(values: FloatArray, less: FloatArray, stage: int) -> FloatArray:
        window = slice(stage, stage + ticks)
        return values[window] + less[stage, window]

    lower = [at(free.lower, reserve, j) for j in range(horizon)]
    upper = [at(free.upper, -reserve, j) for j in range(horizon)]
    step_lower = [at(free.step_lower, of_rates, j) for j in range(moves)]
    step_upper = [at(free.step_upper, -of_rates, j) for j in range(moves)]
    low, high = np.maximum.reduce(lower[moves - 1 :]), np.minimum.reduce(upper[moves - 1 :])
    lower[moves - 1], upper[moves - 1] = low, high
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
