"""Articulated model as CasADi expressions, with derivatives along a horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any, ClassVar, Protocol

import numpy as np

from ..errors import MissingPackage
from ..types import Disturbance, FloatArray, Input, State
from ..vehicle import Vehicle

_N, _M, _D = len(State), len(Input), len(Disturbance)

# Longest classical Runge-Kutta step over the shortest lag: over a horizon of four seconds both axle
# points then stay within a millimetre of much finer steps, which a test checks.
_STEP_PER_LAG = 0.75


def load_casadi() -> ModuleType:
    """Return CasADi, an optional package, imported on first use.

    Raises:
        MissingPackage: it is not installed; with the command that installs it.
    """
    try:
        import casadi
    except ImportError:
        raise MissingPackage(
            "the NMPC controllers need CasADi, which is not installed: "
            "pip install 'ttempc[baselines]'"
        ) from None
    return casadi


@dataclass(frozen=True, slots=True)
class Subsystem:
    """Inputs, outputs and states of one NMPC."""

    inputs: tuple[int, ...]  # of `Input`: those that it decides; the others are given
    outputs: tuple[int, ...]  # position errors: x, y of the tractor, x, y of the trailer
    states: tuple[int, ...]  # of `State`: those that depend on its inputs
    simulated: tuple[int, ...]  # of `State`: those that its outputs need; others stay constant


WHOLE = Subsystem(
    inputs=tuple(Input), outputs=(0, 1, 2, 3), states=tuple(State), simulated=tuple(State)
)
_TRACTOR_STATES = (State.X, State.Y, State.PSI_T, State.DELTA_T, State.V)
TRACTOR = Subsystem((Input.DELTA_T, Input.HP), (0, 1), _TRACTOR_STATES, _TRACTOR_STATES)
TRAILER = Subsystem((Input.DELTA_I,), (2, 3), (State.PSI_I, State.DELTA_I), tuple(State))


class Expressions(Protocol):
    """A model of 7 states, 3 inputs and 5 disturbances on CasADi's symbols."""

    targets: ClassVar[int]  # entries of `poses`

    def after(self, state: Any, inputs: Any, disturbance: Any, period_s: float) -> Any:  # noqa: ANN401
        """Return the state after a period of constant inputs, (7,)."""
        ...

    def position_errors(self, state: Any, poses: Any) -> Any:  # noqa: ANN401 - CasADi
        """Return the outputs that are minimised, (p,), for the targets `poses`."""
        ...


class ArticulatedExpressions:
    """Equations of `ttempc.models.kinematics` on CasADi's symbols."""

    targets: ClassVar[int] = 6  # x, y, psi of tractor and of trailer

    def __init__(self, vehicle: Vehicle) -> None:
        self._ca = load_casadi()
        self._vehicle = vehicle

    def rate(self, state: Any, inputs: Any, disturbance: Any) -> Any:  # noqa: ANN401 - CasADi
        """Return `ttempc.models.kinematics.articulated`, (7,)."""
        ca, vehicle = self._ca, self._vehicle
        _, _, psi_t, psi_i, delta_t, delta_i, v = ca.vertsplit(state)
        u_t, u_i, hp = ca.vertsplit(inputs)
        slip_t, slip_i, bias, drive, _ = ca.vertsplit(disturbance)
        a, d = vehicle.hitch_offset, vehicle.drawbar_length
        lam = psi_t - psi_i
        sin_t, cos_t, cos_l, cos_i = ca.sin(psi_t), ca.cos(psi_t), ca.cos(lam), ca.cos(delta_i)
        rate_t = self._steering(u_t, delta_t, vehicle.steering_lag_t, vehicle.steering_rate_t)
        rate_i = self._steering(u_i, delta_i, vehicle.steering_lag_i, vehicle.steering_rate_i)
        yaw_t = v * ca.tan(delta_t + bias) / vehicle.wheelbase
        across = v * (ca.sin(lam) + slip_t * cos_l - slip_i) - a * yaw_t * cos_l
        yaw_i = (across - d * rate_i * cos_i) / (vehicle.trailer_length + d * cos_i)
        acceleration = (vehicle.speed_gain * hp - v) / vehicle.speed_time_constant + drive
        x, y = v * (cos_t - slip_t * sin_t), v * (sin_t + slip_t * cos_t)
        return ca.vertcat(x, y, yaw_t, yaw_i, rate_t, rate_i, acceleration)

    def after(self, state: Any, inputs: Any, disturbance: Any, period_s: float) -> Any:  # noqa: ANN401
        """Return the state after a period of constant inputs, (7,), by Runge-Kutta steps."""
        lag = min(self._vehicle.steering_lag_t, self._vehicle.steering_lag_i)
        count = math.ceil(period_s / (_STEP_PER_LAG * lag))
        step = period_s / count
        for _ in range(count):
            k1 = self.rate(state, inputs, disturbance)
            k2 = self.rate(state + 0.5 * step * k1, inputs, disturbance)
            k3 = self.rate(state + 0.5 * step * k2, inputs, disturbance)
            k4 = self.rate(state + step * k3, inputs, disturbance)
            state = state + step / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)
        return state

    def position_errors(self, state: Any, poses: Any) -> Any:  # noqa: ANN401 - CasADi
        """Return reference less axle points in the frames of the reference, (4,) [m].

        `poses` (6,) is the reference's: x, y, psi of the tractor, then of the trailer.
        """
        ca, vehicle = self._ca, self._vehicle
        x, y, psi_t, psi_i, _, delta_i, _ = ca.vertsplit(state)
        x_r, y_r, psi_r, x_i, y_i, psi_i_r = ca.vertsplit(poses)
        shape = (
            (vehicle.hitch_offset, psi_t),
            (vehicle.drawbar_length, psi_i + delta_i),
            (vehicle.trailer_length, psi_i),
        )
        back_x = sum(length * ca.cos(angle) for length, angle in shape)
        back_y = sum(length * ca.sin(angle) for length, angle in shape)
        errors = []
        for dx, dy, psi in (
            (x_r - x, y_r - y, psi_r),
            (x_i - x + back_x, y_i - y + back_y, psi_i_r),
        ):
            errors += [ca.cos(psi) * dx + ca.sin(psi) * dy, ca.cos(psi) * dy - ca.sin(psi) * dx]
        return ca.vertcat(*errors)

    def _steering(self, command: Any, angle: Any, lag: float, limit: float) -> Any:  # noqa: ANN401
        return self._ca.fmin(self._ca.fmax((command - angle) / lag, -limit), limit)


class HorizonModel:
    """Position errors along a horizon and their derivatives by the inputs of a subsystem.

    Compiled to CasADi's own virtual machine: no C compiler is needed. One stage is
    differentiated symbolically and called once a period. Results are views of buffers that the
    next call overwrites.
    """

    def __init__(
        self, expressions: Expressions, subsystem: Subsystem, horizon: int, period_s: float
    ) -> None:
        ca = load_casadi()
        size = _M + _D + expressions.targets
        state, given = ca.SX.sym("state", _N), ca.SX.sym("given", size)
        inputs, disturbance, poses = ca.vertsplit(given, [0, _M, _M + _D, size])
        after = expressions.after(state, inputs, disturbance, period_s)
        after = ca.vertcat(*(after[i] if i in subsystem.simulated else state[i] for i in State))
        own, states = list(subsystem.inputs), list(subsystem.states)
        outputs = list(subsystem.outputs)
        end = ca.SX.sym("end", _N)  # the state at the end of the period
        errors = expressions.position_errors(end, poses)
        at_end = ca.Function("at_end", [end, poses], [errors, ca.jacobian(errors, end)])
        error, by_end = at_end(after, poses)
        stage = ca.Function(
            "stage",
            [state, given],
            [
                after,
                ca.densify(ca.jacobian(after[states], state)[:, states]),
                ca.densify(ca.jacobian(after[states], inputs)[:, own]),
                error[outputs],
                ca.densify(by_end[outputs, states]),
            ],
            {"cse": True},
        )
        along = stage.mapaccum("along", horizon)
        # CasADi stores column by column: the same memory, read row by row, is the transpose.
        n, m, p = len(states), len(own), len(outputs)
        self._start = np.zeros(_N)
        self._given = np.zeros((horizon, size))
        self.states = np.zeros((horizon, _N))
        a, b = np.zeros((horizon, n, n)), np.zeros((horizon, m, n))
        self.errors = np.zeros((horizon, p))
        c = np.zeros((horizon, n, p))
        self.by_state = a.transpose(0, 2, 1)  # d state / d state before, (Np, n, n)
        self.by_input = b.transpose(0, 2, 1)  # d state / d input, (Np, n, m)
        self.error_by_state = c.transpose(0, 2, 1)  # (Np, p, n)
        self._buffer, self._run = along.buffer()
        for place, array in enumerate((self._start, self._given)):
            self._buffer.set_arg(place, array.data)
        for place, array in enumerate((self.states, a, b, self.errors, c)):
            self._buffer.set_res(place, array.data)

    def start(self, state: FloatArray, disturbance: FloatArray, poses: FloatArray) -> None:
        """Set the first state (7,), the disturbances (Np, 5) and the targets (Np, 6 or 7)."""
        self._start[:] = state
        self._given[:, _M : _M + _D] = disturbance
        self._given[:, _M + _D :] = poses

    def evaluate(self, inputs: FloatArray) -> None:
        """Run the model under `inputs` (Np, 3) and write errors and derivatives to the buffers."""
        self._given[:, :_M] = inputs
        self._run()
