"""Last accepted plan of an MPC, kept by an ancillary gain where a QP has no solution."""

from __future__ import annotations

import numpy as np

from ..mpc.ordered_product import ordered_product
from ..tube.growing_tube import GrowingTube
from ..types import FloatArray, Input, State

_N, _M = len(State), len(Input)


class KeptPlan:
    """The policy u_e = ubar_j + K m of the last accepted plan, m = zhat - zbar_j.

    zbar_j starts at the estimate at which the plan was made. It follows the model under the planned
    inputs and the disturbances that the estimator gives at each tick. K m saturates at the share of
    the inputs that the tightening has reserved for it; inside the tube it is linear, and the sum
    keeps to the limits of the inputs.

    Args:
        tube: gains and reserves along the reference.
        a: A (T, 16, 16) of `error_dynamics`.
        b: B (T, 16, 3).
    """

    def __init__(self, tube: GrowingTube, a: FloatArray, b: FloatArray) -> None:
        self._tube, self._a, self._b = tube, a, b
        self._made = -1  # tick of the plan
        self._plan: FloatArray = np.zeros(0)
        self._next: tuple[int, FloatArray, FloatArray] | None = None  # tick, zbar, ubar before it

    def fresh(self) -> KeptPlan:
        """Return the object without a plan."""
        return KeptPlan(self._tube, self._a, self._b)

    def record(self, k: int, state: FloatArray, u: FloatArray, plan: FloatArray) -> None:
        """Keep the plan of tick `k` from the `state` (16,), whose first input became `u` (3,)."""
        self._made, self._plan, self._next = k, plan, (k, state, u)

    def inputs(self, k: int, estimate: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Return ubar and K m (3,) of tick `k` at the estimate (16,); None without a plan.

        Up to the last stage of its horizon a plan can be kept, at every tick.
        """
        stage = k - self._made
        if self._next is None or self._next[0] != k - 1 or stage >= len(self._tube.reserve):
            return None
        _, state, u = self._next
        state = ordered_product(self._a[k - 1], state) + ordered_product(self._b[k - 1], u)
        previous, steps = np.split(self._plan[len(state) :].reshape(-1, _M), [1])
        u = previous[0] + steps[: stage + 1].sum(axis=0)
        self._next = k, np.concatenate([state[:_N], estimate[_N:]]), u
        ancillary = ordered_product(self._tube.gains[k], (estimate - state)[:_N])
        reserve = self._tube.reserve[stage, k]
        return u, np.minimum(np.maximum(ancillary, -reserve), reserve)
