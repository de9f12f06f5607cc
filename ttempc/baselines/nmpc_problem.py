"""Problem of an NMPC at one tick, and its condensation to a QP in the free input steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ..jit import cached_njit
from ..mpc.qp import StageBounds
from ..types import FloatArray


@dataclass(frozen=True, slots=True)
class Subsystem:
    """Inputs and outputs of one NMPC."""

    inputs: tuple[int, ...]  # of `Input`: those that it decides; the others are given
    outputs: tuple[int, ...]  # of the model's outputs: those that it minimises


@dataclass(frozen=True, slots=True)
class Task:
    """Data of the problem of one tick."""

    state: FloatArray  # (7,) the estimate
    disturbance: FloatArray  # (Np, 5) predicted as by the linear MPC
    poses: FloatArray  # (Np, 6 or 7) targets at the ends of the periods, for the model
    feedforward: FloatArray  # (Np, 3) u_r
    inputs_e: FloatArray  # (Np, 3) u_e; only the subsystem's own columns are decided
    previous: FloatArray  # (m,) own u_e(k-1)
    bounds: StageBounds  # (m Nc,) each, own


class HorizonModel(Protocol):
    """A nonlinear model over a horizon."""

    def evaluate(
        self, task: Task, steps: FloatArray, errors: FloatArray, jacobian: FloatArray
    ) -> None:
        """Run the model under `steps` (m Nc,).

        Writes the outputs at the ends of the periods into `errors` (Np, p) and their derivatives
        by the steps into `jacobian` (Np, p, m Nc).
        """
        ...


@cached_njit(error_model="numpy", boundscheck=False)
def planned_inputs(
    feedforward: FloatArray,
    inputs_e: FloatArray,
    previous: FloatArray,
    steps: FloatArray,
    own: NDArray[np.intp],
    inputs: FloatArray,
) -> None:
    """Write u = u_r - u_e of all periods into `inputs` (Np, 3); arguments as in `Task`.

    The columns `own` (m,) of u_e follow from the `steps` (m Nc,), the others are `inputs_e`.
    """
    m = own.size
    inputs[:, :] = feedforward - inputs_e
    for i in range(m):
        u_e = previous[i]
        for j in range(len(inputs)):
            if j * m < steps.size:
                u_e += steps[j * m + i]
            inputs[j, own[i]] = feedforward[j, own[i]] - u_e


@cached_njit(error_model="numpy", boundscheck=False)
def propagate(
    by_state: FloatArray,
    by_input: FloatArray,
    own: NDArray[np.intp],
    period: int,
    before: FloatArray,
    after: FloatArray,
) -> None:
    """Write d state / d steps at the end of a `period` into `after` (n, m Nc).

    `before` is the same at its start, `by_state` (n, n) and `by_input` (n, 3) are the derivatives
    of the period; d u / d step i = -1 from period i on.
    """
    m = own.size
    filled = min((period + 1) * m, after.shape[1])
    linear_map(by_state, before, filled, after)
    for row in range(len(after)):
        for i in range(filled):
            after[row, i] -= by_input[row, own[i % m]]


@cached_njit(error_model="numpy", boundscheck=False)
def linear_map(matrix: FloatArray, columns: FloatArray, filled: int, result: FloatArray) -> None:
    """Write `matrix` (r, n) times the first `filled` `columns` (n, c) into `result` (r, c)."""
    result[:, :] = 0.0
    for row in range(len(matrix)):
        for k in range(matrix.shape[1]):
            factor = matrix[row, k]
            if factor != 0.0:  # most are
                for i in range(filled):
                    result[row, i] += factor * columns[k, i]


@cached_njit(error_model="numpy", boundscheck=False)
def condense(
    errors: FloatArray,
    jacobian: FloatArray,
    weight: FloatArray,
    step_weight: FloatArray,
    steps: FloatArray,
    hessian: FloatArray,
    gradient: FloatArray,
) -> float:
    """Return the cost at `steps` (q,), and write the QP of the linearised outputs.

    sum_j y_j' Q y_j + s' R s with y_j = errors_j + jacobian_j (s - steps) is, but for a constant,
    1/2 s'Hs + g's with `hessian` (q, q) and `gradient` (q,).
    """
    cost, q = 0.0, steps.size
    hessian[:, :] = 0.0
    gradient[:] = 0.0
    for j in range(len(errors)):
        for output in range(weight.size):
            row, error = jacobian[j, output], errors[j, output]
            cost += weight[output] * error * error
            rest = error
            for i in range(q):
                rest -= row[i] * steps[i]
            for i in range(q):
                factor = 2.0 * weight[output] * row[i]
                gradient[i] += factor * rest
                for k in range(i + 1):
                    hessian[i, k] += factor * row[k]
    for i in range(q):
        hessian[i, i] += 2.0 * step_weight[i]
        cost += step_weight[i] * steps[i] * steps[i]
        for k in range(i):
            hessian[k, i] = hessian[i, k]
    return cost
