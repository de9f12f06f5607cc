"""Kernels of the condensed MPC problem: response, Hessian, gradient, bounds, closed form.

The unknowns are the input steps Delta U of a horizon, see `ttempc.mpc.lmpc.CondensedHorizon`. Of
the n entries of the state z only the first r change over the horizon; the others are constant.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..jit import cached_njit
from ..types import FloatArray
from .qp import (
    BOUND_ACTIVE,
    CLOSED_FORM,
    NOT_CONVEX,
    NOT_FINITE,
    SOFT_BOUND_ACTIVE,
    SOFT_TOLERANCE,
    check_rows,
    factorise,
    is_within,
    minimise_unconstrained,
)

ACQUISITION_BEGINS_M: Final = 0.5
"""Cross-track error, or its damped one, from which the vehicle acquires its line; assumed."""
ACQUISITION_ENDS_M: Final = 0.1
"""Both errors with which the acquisition ends; assumed."""


class StageBounds(NamedTuple):
    """Bounds on the input u_e of every tick and on its change from the previous one, (N, m)."""

    lower: FloatArray
    upper: FloatArray
    step_lower: FloatArray
    step_upper: FloatArray

    def at(self, *index: int | slice | NDArray[np.intp]) -> StageBounds:
        """Return the bounds at an index of the arrays."""
        return StageBounds(*(values[index] for values in self))

    def clamp(self, inputs: FloatArray) -> FloatArray:
        """Return the allowed first input nearest to `inputs` (m,), of the bounds of one tick."""
        first = slice(len(inputs))
        return np.minimum(np.maximum(inputs, self.lower[first]), self.upper[first])

    def clamp_previous(self, previous: FloatArray) -> FloatArray:
        """Return the input nearest to `previous` (m,) from which a step leads into the bounds.

        From an input beyond them, the QP of the tick is infeasible.
        """
        lower, upper, step_lower, step_upper = self.at(slice(len(previous)))
        return np.minimum(np.maximum(previous, lower - step_upper), upper - step_lower)


class FreeSteps(NamedTuple):
    """Free input steps of a horizon; the input is held between them and afterwards."""

    stages: NDArray[np.int64]  # of each step, the first 0 (Nc,)
    periods: FloatArray  # for which each step stands, a ramp drawn as one step (Nc,)

    @classmethod
    def single(cls, count: int) -> FreeSteps:
        """Return a step at each of the first stages."""
        return cls(np.arange(count), np.ones(count))

    @classmethod
    def blocks(cls, count: int, periods: float) -> FreeSteps:
        """Return a step of one period, then steps that stand for as many periods each.

        A step is in the middle of the ramp for which it stands: with blocks of one period, the
        steps are `single` ones.
        """
        middles = np.ceil(periods * (np.arange(1, count) - 0.5)).astype(np.int64)
        spans = np.full(count, float(periods))
        spans[0] = 1.0
        return cls(np.concatenate([np.zeros(1, np.int64), middles]), spans)


class FreeInputs(NamedTuple):
    """Free steps of a horizon, and the bounds on their stages at every tick."""

    steps: FreeSteps
    bounds: StageBounds  # (ticks, m Nc)


class Stages(NamedTuple):
    """Arrays of a `CondensedHorizon` along a reference of N stages."""

    a: FloatArray  # the r rows of A that change the state, (N, r, n)
    b: FloatArray  # the same rows of B, (N, r, m)
    outputs: FloatArray  # C (N + 1, p, r)
    bounds: StageBounds  # of the free stages of every tick, (ticks, m Nc)
    columns: NDArray[np.int64]  # number of unknowns up to each stage (Np,)
    matrix: FloatArray  # from the steps to the inputs after the first one, (m Nc - m, m Nc)
    output_weight: FloatArray  # diagonal of Q of every tick (N + 1, p)
    step_weight: FloatArray  # diagonal of R of every step (m Nc,)
    soft_rows: FloatArray  # S (N + 1, s, r) of the soft bounds; (0, 0, r) without them
    soft_lower: FloatArray  # (N + 1, s)
    soft_upper: FloatArray  # (N + 1, s)
    soft_spread: FloatArray  # taken off the soft bounds at each stage, (Np + 1, s)
    soft_penalty: FloatArray  # (s,)
    acquisition_outputs: FloatArray  # in place of C while the line is acquired; (0, p, n): never


class Work(NamedTuple):
    """Arrays of one tick of a `CondensedHorizon`."""

    tick: FloatArray  # of Hessian, factor and response, -1: none (1,)
    condensed_acquiring: FloatArray  # 1 where these have the rows of the acquisition (1,)
    hessian: FloatArray  # (m Nc, m Nc)
    factor: FloatArray  # of Cholesky (m Nc, m Nc)
    response: FloatArray  # of z_{k+1} ... z_{k+Np} to the steps, (Np, r, m Nc)
    acquiring: FloatArray  # 1 while the vehicle acquires its line (1,)
    state: FloatArray  # z_k (n,)
    previous: FloatArray  # u_{k-1} (m,)
    preview: FloatArray  # what z_{k+1} ... z_{k+Np} each gain beside the model, (Np, r)
    free: FloatArray  # z_k ... z_{k+Np} with the previous input held, (Np + 1, r)
    gradient: FloatArray  # (m Nc,)
    row_lower: FloatArray  # on the inputs after the first one, less the previous (m Nc - m,)
    row_upper: FloatArray  # (m Nc - m,)
    step_lower: FloatArray  # (m Nc,)
    step_upper: FloatArray  # (m Nc,)
    steps: FloatArray  # the minimiser (m Nc,)
    backup_previous: FloatArray  # input before the backup plan, see `ttempc.laws` (m,)
    backup_steps: FloatArray  # steps of the backup plan (m Nc,)

    def with_shared_matrices(self) -> Work:
        """Return arrays of which tick, Hessian, factor and response are these."""
        shared = ("tick", "condensed_acquiring", "hessian", "factor", "response")
        own = {name: getattr(self, name).copy() for name in self._fields if name not in shared}
        return self._replace(**own)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_response(k: int, stages: Stages, response: FloatArray) -> None:
    """Write the response (Np, r, m Nc) of z_{k+1} ... z_{k+Np} to the steps.

    Column i is that to a step of the input i mod m at the stage of step i / m, which lasts.
    """
    horizon, r, size = response.shape
    m = stages.b.shape[2]
    for j in range(horizon):
        earlier = stages.columns[j - 1] if j > 0 else 0  # columns of the steps before stage j
        now = stages.columns[j]  # and of those up to it
        for i in range(r):
            for column in range(now):
                response[j, i, column] = stages.b[k + j, i, column % m]
            for column in range(now, size):
                response[j, i, column] = 0.0
            for n in range(r):
                slope = stages.a[k + j, i, n]
                if slope == 0.0:
                    continue
                for column in range(earlier):
                    response[j, i, column] += slope * response[j - 1, n, column]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_hessian(k: int, stages: Stages, outputs: FloatArray, work: Work) -> None:
    """Write H = 2 sum_j G_j' Q G_j + 2 R, with the response G_j of the outputs at stage j."""
    response = work.response
    hessian = work.hessian
    horizon, r, size = response.shape
    row = np.empty(size)  # of G_j

    for a in range(size):
        for b in range(a + 1):
            hessian[a, b] = 0.0
    for j in range(horizon):
        now = stages.columns[j]
        for p in range(stages.output_weight.shape[1]):
            weight = stages.output_weight[k + j + 1, p]
            if weight == 0.0:
                continue
            for a in range(now):
                row[a] = 0.0
            for n in range(r):
                slope = outputs[k + j + 1, p, n]
                if slope == 0.0:
                    continue
                for a in range(now):
                    row[a] += slope * response[j, n, a]
            for a in range(now):
                weighted = 2.0 * weight * row[a]
                for b in range(a + 1):
                    hessian[a, b] += weighted * row[b]
    for a in range(size):
        hessian[a, a] += 2.0 * stages.step_weight[a]
        for b in range(a):
            hessian[b, a] = hessian[a, b]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True, inline="always")
def cost_outputs(stages: Stages, work: Work) -> FloatArray:
    """Return the outputs that the cost weighs: while the line is acquired, the damped ones."""
    if work.acquiring[0] != 0.0:
        return stages.acquisition_outputs
    return stages.outputs


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def condense(k: int, stages: Stages, work: Work) -> bool:
    """Write response, Hessian and its factor of tick `k`; whether the cost is finite and convex."""
    write_response(k, stages, work.response)
    write_hessian(k, stages, cost_outputs(stages, work), work)
    is_convex = factorise(work.hessian, work.factor)
    work.tick[0] = k if is_convex else -1.0
    work.condensed_acquiring[0] = work.acquiring[0]
    return is_convex


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def clamp_previous(k: int, bounds: StageBounds, previous: FloatArray) -> None:
    """Move the previous input to the nearest one from which a step leads into the bounds."""
    for i in range(previous.size):
        lower = bounds.lower[k, i] - bounds.step_upper[k, i]
        upper = bounds.upper[k, i] - bounds.step_lower[k, i]
        previous[i] = min(max(previous[i], lower), upper)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def predict_free(k: int, stages: Stages, work: Work) -> None:
    """Write the states z_k ... z_{k+Np} with the previous input held."""
    horizon, r, _ = work.response.shape
    n = work.state.size
    free = work.free
    for i in range(r):
        free[0, i] = work.state[i]
    for j in range(horizon):
        for i in range(r):
            total = work.preview[j, i]
            for c in range(r):
                total += stages.a[k + j, i, c] * free[j, c]
            for c in range(r, n):
                total += stages.a[k + j, i, c] * work.state[c]
            for c in range(work.previous.size):
                total += stages.b[k + j, i, c] * work.previous[c]
            free[j + 1, i] = total


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_gradient(k: int, stages: Stages, outputs: FloatArray, work: Work) -> None:
    """Write the gradient at Delta U = 0 by the adjoint of the model, from the last stage back."""
    horizon, r, _ = work.response.shape
    m = stages.b.shape[2]
    slope = np.zeros(r)  # of the cost of all later stages by the state
    ahead = np.empty(r)
    lasting = np.zeros(m)  # of the cost by an input that lasts from a stage on

    for j in range(horizon - 1, -1, -1):
        for i in range(r):
            ahead[i] = slope[i]
            slope[i] = 0.0

        # outputs of z_{k+j+1}, with the entries that are constant
        for p in range(stages.output_weight.shape[1]):
            error = 0.0
            for i in range(r):
                error += outputs[k + j + 1, p, i] * work.free[j + 1, i]
            for i in range(r, outputs.shape[2]):
                error += outputs[k + j + 1, p, i] * work.state[i]
            error *= 2.0 * stages.output_weight[k + j + 1, p]
            for i in range(r):
                ahead[i] += error * outputs[k + j + 1, p, i]

        for i in range(r):
            for c in range(r):
                slope[c] += stages.a[k + j, i, c] * ahead[i]
            for c in range(m):
                lasting[c] += stages.b[k + j, i, c] * ahead[i]
        first = stages.columns[j - 1] if j > 0 else 0
        for c in range(stages.columns[j] - first):  # of the step at this stage, if any
            work.gradient[first + c] = lasting[c]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_bounds(k: int, bounds: StageBounds, work: Work) -> None:
    """Write the bounds on the steps, and those on the inputs less the previous one.

    The first input is bounded by its step: no row repeats it.
    """
    m = work.previous.size
    for c in range(work.steps.size):
        lower = bounds.lower[k, c] - work.previous[c % m]
        upper = bounds.upper[k, c] - work.previous[c % m]
        work.step_lower[c] = bounds.step_lower[k, c]
        work.step_upper[c] = bounds.step_upper[k, c]
        if c < m:
            work.step_lower[c] = max(lower, work.step_lower[c])
            work.step_upper[c] = min(upper, work.step_upper[c])
        else:
            work.row_lower[c - m] = lower
            work.row_upper[c - m] = upper


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def build_gradient_and_bounds(k: int, stages: Stages, work: Work) -> None:
    """Write free response, gradient and bounds of tick `k` for its state and previous input.

    A previous input from which no step leads into the bounds is moved to the nearest other one
    first: the QP is infeasible there.
    """
    clamp_previous(k, stages.bounds, work.previous)
    predict_free(k, stages, work)
    write_gradient(k, stages, cost_outputs(stages, work), work)
    write_bounds(k, stages.bounds, work)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def keeps_soft_bounds(k: int, stages: Stages, work: Work) -> bool:
    """Whether the steps of tick `k` keep to all soft bounds."""
    horizon, r, size = work.response.shape
    rows = stages.soft_rows
    state = np.empty(r)  # of a stage, as far as a row needs it
    for j in range(1, horizon + 1):
        for i in range(r):
            state[i] = math.nan
        for p in range(rows.shape[1]):
            value = 0.0
            for i in range(r):
                if rows[k + j, p, i] == 0.0:
                    continue
                if math.isnan(state[i]):
                    state[i] = work.free[j, i]
                    for a in range(size):
                        state[i] += work.response[j - 1, i, a] * work.steps[a]
                value += rows[k + j, p, i] * state[i]
            lower = stages.soft_lower[k + j, p] + stages.soft_spread[j, p]
            upper = stages.soft_upper[k + j, p] - stages.soft_spread[j, p]
            if not lower - SOFT_TOLERANCE <= value <= upper + SOFT_TOLERANCE:
                return False
    return True


@cached_njit(error_model="numpy", boundscheck=False, nogil=True, inline="always")
def update_acquisition(k: int, stages: Stages, work: Work) -> None:
    """Write whether the vehicle acquires its line at tick `k`: with hysteresis, by its errors."""
    damped_outputs = stages.acquisition_outputs
    largest = 0.0
    for p in range(damped_outputs.shape[1] if damped_outputs.shape[0] else 0):
        error = 0.0
        change = 0.0  # of the damped error from the error itself
        for i in range(damped_outputs.shape[2]):
            slope = stages.outputs[k, p, i] if i < stages.outputs.shape[2] else 0.0
            error += slope * work.state[i]
            change += (damped_outputs[k, p, i] - slope) * work.state[i]
        if change != 0.0:  # of an output that is damped
            largest = max(largest, abs(error), abs(error + change))
    limit = ACQUISITION_ENDS_M if work.acquiring[0] != 0.0 else ACQUISITION_BEGINS_M
    work.acquiring[0] = 1.0 if largest > limit else 0.0


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def solve_in_closed_form(k: int, stages: Stages, work: Work) -> int:
    """Write the steps of tick `k` for its state and previous input, where no bound is active.

    Returns:
        `CLOSED_FORM`; else `BOUND_ACTIVE` or `SOFT_BOUND_ACTIVE`, `NOT_FINITE` or `NOT_CONVEX`:
        `ttempc.mpc.lmpc.LinearMpc.complete` then gives the steps.
    """
    update_acquisition(k, stages, work)
    is_known = work.tick[0] == k and work.condensed_acquiring[0] == work.acquiring[0]
    if not is_known and not condense(k, stages, work):
        return NOT_CONVEX
    build_gradient_and_bounds(k, stages, work)

    if not minimise_unconstrained(work.factor, work.gradient, work.steps):
        return NOT_FINITE
    outcome = check_rows(stages.matrix, work.row_lower, work.row_upper, work.steps)
    if outcome != CLOSED_FORM:
        return outcome
    if not is_within(work.step_lower, work.step_upper, work.steps):
        return BOUND_ACTIVE
    if stages.soft_rows.shape[0] and not keeps_soft_bounds(k, stages, work):
        return SOFT_BOUND_ACTIVE
    return CLOSED_FORM
