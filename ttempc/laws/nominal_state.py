"""Nominal tracking error of a robust law, in two readings."""

from __future__ import annotations

from typing import Literal

from ..types import FloatArray

Reading = Literal["one-step", "tube"]


class NominalState:
    """The nominal tracking error zbar_e, which the paper uses and does not define.

    `one-step`: the prediction of the linear model from the previous error and feedback,

        zbar(k) = A_{k-1} z_e(k-1) + B_{k-1} u_b(k-1).

    `tube`: the nominal system of Mayne, Seron and Rakovic (2005), which starts at z_e and then
    follows the model alone. The MPC acts on it, and the robust law keeps the vehicle near it,

        zbar(k) = A_{k-1} zbar(k-1) + B_{k-1} u_b(k-1).

    Both start at zbar = z_e, and start again there after a missed tick.

    Args:
        a: A (N, n, n) over one period.
        b: B (N, n, m) over one period.
        reading: which of the two.
    """

    def __init__(self, a: FloatArray, b: FloatArray, reading: Reading) -> None:
        self._a = a
        self._b = b
        self._reading: Reading = reading
        self._state: FloatArray | None = None
        self._tick = -1

    def fresh(self) -> NominalState:
        """Return the nominal state before its first tick."""
        return NominalState(self._a, self._b, self._reading)

    def at(self, k: int, error: FloatArray) -> FloatArray:
        """Return zbar_e (n,) at tick `k`, where the estimated tracking error is `error` (n,)."""
        return error if self._state is None or k != self._tick else self._state

    def mpc_state(self, nominal: FloatArray, error: FloatArray) -> FloatArray:
        """Return the state on which the MPC acts, (n,)."""
        return nominal if self._reading == "tube" else error

    def advance(self, k: int, state: FloatArray, feedback: FloatArray) -> None:
        """Predict tick k + 1 from the MPC's `state` (n,) and the `feedback` u_b (m,)."""
        self._state = self._a[k] @ state + self._b[k] @ feedback
        self._tick = k + 1
