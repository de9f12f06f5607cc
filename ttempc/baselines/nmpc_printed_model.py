"""Printed model of tractor and trailer with slip factors, as CasADi expressions.

With slip factors mu (driven wheels), kappa (front steering) and eta (trailer steering),

    x_t' = mu v cos(psi_t),   y_t' = mu v sin(psi_t),   psi_t' = mu v tan(kappa delta_t) / L_t
    x_i' = mu v cos(psi_i),   y_i' = mu v sin(psi_i)
    psi_i' = mu v (sin(l) + s (L_d / L_t) tan(kappa delta_t) cos(l)) / L_i,   l = eta delta_i + beta
    v' = (K hp - v) / tau.

With factors of 1 and s = +1 this is eq. (kinematicmodel) of Kayacan, Ramon and Saeys (2016), with
lambda = beta + delta_i; s is `PaperEquations.hitch_sign`. That the NMPC of this vehicle has slip
factors as parameters is in that paper; their places are from memory of Kayacan, Kayacan, Ramon and
Saeys (2015), "Learning in centralized nonlinear model predictive control: application to an
autonomous tractor-trailer system", IEEE Transactions on Control Systems Technology 23(1).
"""

from __future__ import annotations

from typing import Any, ClassVar

from ..types import FloatArray
from ..vehicle import Vehicle
from .nmpc_model import Subsystem, load_casadi

STATES = 7  # x_t, y_t, psi_t, x_i, y_i, psi_i, v: v is the speed of the rims
FACTORS = 3  # mu, kappa, eta
WINDOW_INPUTS = 5  # delta_t, delta_i, hp, beta, length of the period [s]
PRINTED = Subsystem((0, 1, 2), (0, 1, 2, 3, 4), tuple(range(STATES)), tuple(range(STATES)))


class PrintedExpressions:
    """The model as an NMPC takes it: inputs delta_t, lambda, hp; slip factors and beta are given.

    `disturbance` holds mu, kappa, eta, beta and nothing. beta stays as it was measured. The targets
    are x, y, psi of tractor and trailer and the speed of the rims.
    """

    targets: ClassVar[int] = 7

    def __init__(self, vehicle: Vehicle, hitch_sign: int) -> None:
        self._ca = load_casadi()
        self._vehicle = vehicle
        self._hitch_sign = hitch_sign

    def rate(self, state: Any, steering: Any, factors: Any) -> Any:  # noqa: ANN401 - CasADi
        """Return the derivative (7,); `steering` is delta_t, delta_i, hp, beta."""
        ca, vehicle = self._ca, self._vehicle
        _, _, psi_t, _, _, psi_i, v = ca.vertsplit(state)
        delta_t, delta_i, hp, beta = ca.vertsplit(steering)
        mu, kappa, eta = ca.vertsplit(factors)
        ground, turn = mu * v, ca.tan(kappa * delta_t) / vehicle.wheelbase
        lam = eta * delta_i + beta
        lever = self._hitch_sign * vehicle.drawbar_offset
        yaw_i = ground * (ca.sin(lam) + lever * turn * ca.cos(lam)) / vehicle.trailer_length
        return ca.vertcat(
            ground * ca.cos(psi_t),
            ground * ca.sin(psi_t),
            ground * turn,
            ground * ca.cos(psi_i),
            ground * ca.sin(psi_i),
            yaw_i,
            (vehicle.speed_gain * hp - v) / vehicle.speed_time_constant,
        )

    def step(self, state: Any, steering: Any, factors: Any, period_s: Any) -> Any:  # noqa: ANN401
        """Return the state after `period_s`, by one classical Runge-Kutta step."""
        k1 = self.rate(state, steering, factors)
        k2 = self.rate(state + 0.5 * period_s * k1, steering, factors)
        k3 = self.rate(state + 0.5 * period_s * k2, steering, factors)
        k4 = self.rate(state + period_s * k3, steering, factors)
        return state + period_s / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

    def after(self, state: Any, inputs: Any, disturbance: Any, period_s: float) -> Any:  # noqa: ANN401
        """Return the state after a period of constant inputs, see `Expressions`."""
        ca = self._ca
        delta_t, lam, hp = ca.vertsplit(inputs)
        beta = disturbance[FACTORS]
        steering = ca.vertcat(delta_t, lam - beta, hp, beta)
        return self.step(state, steering, disturbance[:FACTORS], period_s)

    def position_errors(self, state: Any, poses: Any) -> Any:  # noqa: ANN401 - CasADi
        """Return target less position in the frames of the targets, then of the speed, (5,)."""
        ca = self._ca
        x, y, _, x_i, y_i, _, v = ca.vertsplit(state)
        x_r, y_r, psi_r, x_ir, y_ir, psi_ir, v_r = ca.vertsplit(poses)
        errors = []
        for dx, dy, psi in ((x_r - x, y_r - y, psi_r), (x_ir - x_i, y_ir - y_i, psi_ir)):
            errors += [ca.cos(psi) * dx + ca.sin(psi) * dy, ca.cos(psi) * dy - ca.sin(psi) * dx]
        return ca.vertcat(*errors, v_r - v)


class WindowModel:
    """States along a window of periods, from its first state and slip factors.

    Args:
        vehicle: its constants.
        hitch_sign: see `PaperEquations`.
        periods: in the window.
    """

    def __init__(self, vehicle: Vehicle, hitch_sign: int, periods: int) -> None:
        expressions = PrintedExpressions(vehicle, hitch_sign)
        ca = load_casadi()
        unknown = ca.SX.sym("unknown", STATES + FACTORS)
        given = ca.SX.sym("given", WINDOW_INPUTS)
        state, factors = unknown[:STATES], unknown[STATES:]
        end = expressions.step(state, given[:4], factors, given[4])
        one = ca.Function("one", [unknown, given], [ca.vertcat(end, factors)])
        # From the first unknown to the end of every period, differentiated forward.
        along = one.mapaccum("along", periods)
        first = ca.MX.sym("first", STATES + FACTORS)
        inputs = ca.MX.sym("inputs", WINDOW_INPUTS, periods)
        states = ca.vec(along(first, inputs))
        self._run = ca.Function("window", [first, inputs], [states, ca.jacobian(states, first)])

    def along(self, first: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the unknowns at the ends of the periods, (n, 10), and their derivatives.

        Args:
            first: state and slip factors at the start, (10,).
            inputs: (n, 5) delta_t, delta_i, hp, beta, length of the period [s].

        Returns:
            The unknowns, and their derivatives by the first, (n, 10, 10).
        """
        states, jacobian = self._run(first, inputs.T)
        size = STATES + FACTORS
        return states.full().reshape(-1, size), jacobian.full().reshape(-1, size, size)
