"""Norm-optimal iterative learning of the inputs of a repeated drive.

A stabilised drive is repeated under the same disturbances. From the errors y of the last drive the
inputs w of the next one follow, with the linear model of the loop: their change dw minimises

    sum_k |y_k + C_k dz_k|^2_Q + |dw_k|^2_R,
    dz_(k+1) = (A_k - B_k K_k) dz_k + B_k dw_k,   dz_0 = 0.

N. Amann, D. H. Owens and E. Rogers, "Iterative learning control for discrete-time systems with
exponential rate of convergence", IEE Proceedings - Control Theory and Applications 143(2), 1996.
Where the loop is its model, every drive lowers the weighted error, down to the least that any
inputs permit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ttempc.types import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class LinearLoop:
    """Error dynamics z_(k+1) = A z_k + B u_k of N ticks with outputs C z, under u = -K z + w."""

    a: FloatArray  # (N, n, n)
    b: FloatArray  # (N, n, m)
    c: FloatArray  # (N + 1, p, n)
    gain: FloatArray  # (N, m, n), K

    @property
    def ticks(self) -> int:
        """Number of inputs N."""
        return len(self.b)

    def closed(self, k: int) -> FloatArray:
        """Return A - B K of a tick, (n, n)."""
        return self.a[k] - self.b[k] @ self.gain[k]


def learning_step(
    loop: LinearLoop, errors: FloatArray, output_weight: FloatArray, input_weight: FloatArray
) -> FloatArray:
    """Return the change dw of the inputs after a drive, (N, m).

    Args:
        loop: model of the drive.
        errors: outputs y of the last drive, (N + 1, p).
        output_weight: diagonals of Q, (N + 1, p), at least 0; 0 where an output does not count.
        input_weight: diagonal of R, (m,), above 0.

    Raises:
        ValueError: the shapes do not belong together, or a number is not finite.
    """
    outputs = loop.c.shape[:2]
    if errors.shape != outputs or output_weight.shape != outputs:
        raise ValueError(
            f"errors {errors.shape} and output_weight {output_weight.shape}: must be {outputs}"
        )
    if not (np.isfinite(errors).all() and np.isfinite(output_weight).all()):
        raise ValueError("errors and output_weight must be finite: give no error the weight 0")
    gains, offsets = _backward(loop, errors, output_weight, input_weight)
    change = np.empty_like(offsets)
    dz = np.zeros(loop.a.shape[1])
    for k in range(loop.ticks):
        change[k] = -gains[k] @ dz - offsets[k]
        dz = loop.closed(k) @ dz + loop.b[k] @ change[k]
    return change


def _backward(
    loop: LinearLoop, errors: FloatArray, output_weight: FloatArray, input_weight: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return gains (N, m, n) and offsets (N, m) of dw_k = -gain dz_k - offset.

    The cost to go from tick k is dz' P dz + 2 g' dz and a constant.
    """
    ticks, n, m = loop.b.shape
    gains = np.empty((ticks, m, n))
    offsets = np.empty((ticks, m))
    value = np.zeros((n, n))  # P
    slope = np.zeros(n)  # g
    effort = np.diag(input_weight)
    for k in reversed(range(ticks)):
        # the outputs of tick k + 1 join the cost to go
        weighted = loop.c[k + 1].T * output_weight[k + 1]
        value = value + weighted @ loop.c[k + 1]
        slope = slope + weighted @ errors[k + 1]

        # the best input of tick k
        closed = loop.closed(k)
        spread = loop.b[k].T @ value
        hessian = effort + spread @ loop.b[k]
        gains[k] = np.linalg.solve(hessian, spread @ closed)
        offsets[k] = np.linalg.solve(hessian, loop.b[k].T @ slope)

        # cost to go under that input
        left = closed - loop.b[k] @ gains[k]
        value = closed.T @ value @ left
        value = 0.5 * (value + value.T)
        slope = left.T @ slope
    return gains, offsets
