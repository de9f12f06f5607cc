"""Tube that grows from the estimate over the horizon, and the bounds that it leaves to the inputs.

The nominal state of a tick starts at the estimate, so that the deviation m is 0 at stage 0. Under
u_e = ubar + K m and the disturbances of later steps, m at stage j lies in the reachable set S_j,
and the planned input of that stage is tightened by K S_j (Chisci, Rossiter and Zappa 2001). The
first input is not tightened: nothing about it is uncertain.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..limits import CommandLimits
from ..mpc.articulated_error import remaining_bounds
from ..mpc.qp import HorizonTuning, StageBounds, stage_bounds
from ..types import FloatArray
from .disturbance_set import DisturbanceSet
from .reference_tube import TubeDesign, tracking_system
from .tube import TrackingSystem

# Largest share of an input's distance to its limit that is reserved, assumed: the plan keeps the
# rest, so that the reference stays inside the bounds wherever it is inside the limits.
_MOST_RESERVED = 0.97


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
        system = tracking_system(a, b, c, design.weights)
        inputs, rates = reachable_inputs(system, design.disturbance, tuning.horizon)
        limits = CommandLimits.of(design.vehicle, design.period_s)
        free = stage_bounds(tuning, design.period_s, len(a), remaining_bounds(feedforward, limits))
        reserve = np.minimum(inputs, _reservable(free.lower, free.upper))
        of_rates = np.minimum(rates, _reservable(free.step_lower, free.step_upper))
        bounds = horizon_bounds(free, reserve, of_rates, tuning.moves)
        return cls(system.gains, reserve, bounds)


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
    energy, blocks = np.zeros_like(rows), np.zeros(rows.shape[:2])
    half, tick = np.zeros((horizon, *rows.shape[:2])), np.arange(len(gains))
    for step in range(1, horizon):
        energy += (rows @ disturbance.axes) ** 2
        tick = system.before[tick]
        rows = rows @ system.closed[tick]
        if step == 1:  # K(k) m(k) - K(k-1) m(k-1): w(k-1) acts through the first term alone
            rows[:, m:] -= gains[tick]
        half[step] = blocks + disturbance.reach(energy)
        if step % disturbance.window == 0:
            blocks, energy = half[step], np.zeros_like(energy)
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
