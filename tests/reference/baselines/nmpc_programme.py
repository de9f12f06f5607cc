"""The NMPC's problem as a sparse nonlinear programme, solved by CasADi's fatrop.

`ttempc.baselines.nmpc` condenses the same problem to its free input steps. Here every state
is an unknown (multiple shooting), the model is written on CasADi's symbols, and the method is an
interior-point one.
"""

from __future__ import annotations

import copy
import math

import casadi as ca
import numpy as np

from ttempc.baselines.nmpc import Plan
from ttempc.baselines.nmpc_model import WHOLE, Subsystem, Task
from ttempc.mpc.lmpc import HorizonTuning
from ttempc.reference.reference import Reference
from ttempc.types import Disturbance, FloatArray, Input, SolverReport, State
from ttempc.vehicle import Vehicle

_N, _M, _D = len(State), len(Input), len(Disturbance)
_NODE = _N + _M  # a state and the u_e that led there
_GIVEN = _M + _D + 6  # of a period: feedforward, disturbance, poses of the reference at its end
_STEP_PER_LAG = 0.75  # longest Runge-Kutta step, as in `ttempc.baselines.nmpc_model`
_OPTIONS = {
    "print_time": False,
    "expand": True,
    "structure_detection": "auto",
    "fatrop": {"print_level": 0, "tol": 1e-10},
}


class ArticulatedExpressions:
    """Equations of `ttempc.models.kinematics` on CasADi's symbols."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle

    def rate(self, state, inputs, disturbance):
        """Return `ttempc.models.kinematics.articulated`, (7,)."""
        vehicle = self._vehicle
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

    def after(self, state, inputs, disturbance, period_s: float):
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

    def position_errors(self, state, poses):
        """Return reference less axle points in the frames of the reference, (4,) [m].

        `poses` (6,) is the reference's: x, y, psi of the tractor, then of the trailer.
        """
        vehicle = self._vehicle
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

    def _steering(self, command, angle, lag: float, limit: float):
        return ca.fmin(ca.fmax((command - angle) / lag, -limit), limit)


class Programme:
    """Nonlinear programme in (x_0, u_e,-1), Delta u_e,0, (x_1, u_e,0), ...; steps in Nc periods."""

    def __init__(
        self,
        reference: Reference,
        subsystem: Subsystem,
        tuning: HorizonTuning,
        period_s: float,
    ) -> None:
        assert subsystem is WHOLE
        expressions = ArticulatedExpressions(reference.vehicle)
        horizon, moves = tuning.horizon, tuning.moves
        sizes = [*(_NODE, _M) * moves, *(_NODE,) * (horizon + 1 - moves)]
        ends = np.cumsum(sizes)
        places = [slice(end - size, end) for end, size in zip(ends, sizes, strict=True)]
        self._nodes = [place for place, size in zip(places, sizes, strict=True) if size == _NODE]
        self._steps = [place for place, size in zip(places, sizes, strict=True) if size == _M]
        self._size = int(ends[-1])

        unknowns = ca.SX.sym("unknowns", self._size)
        given = ca.SX.sym("given", _NODE + horizon * _GIVEN)
        weights = ca.DM(tuning.output_weight), ca.DM(tuning.step_weight)
        gaps, outputs, cost = [], [], 0.0
        for j in range(horizon):
            node, ahead = unknowns[self._nodes[j]], unknowns[self._nodes[j + 1]]
            state, u_e = node[:_N], node[_N:]
            if j < moves:
                step = unknowns[self._steps[j]]
                u_e, cost = u_e + step, cost + ca.dot(weights[1], step**2)
            of_period = given[_NODE + j * _GIVEN : _NODE + (j + 1) * _GIVEN]
            feedforward, disturbance, poses = ca.vertsplit(of_period, [0, _M, _M + _D, _GIVEN])
            after = expressions.after(state, feedforward - u_e, disturbance, period_s)
            gaps.append(ahead - ca.vertcat(after, u_e))
            if j == 0:
                gaps.append(node - given[:_NODE])
            errors = expressions.position_errors(ahead[:_N], poses)
            outputs.append(errors)
            cost = cost + ca.dot(weights[0], errors**2)
        constraints = ca.vertcat(*gaps)
        options = {**_OPTIONS, "equality": [True] * constraints.numel()}
        problem = {"x": unknowns, "f": cost, "g": constraints, "p": given}
        self._solve = ca.nlpsol("programme", "fatrop", problem, options)
        self._errors = ca.Function("errors", [unknowns, given], [ca.horzcat(*outputs)])
        self._solution: FloatArray | None = None

    def minimise(self, task: Task, steps: FloatArray) -> Plan:
        """Return the plan of a task, started at the last solution; `steps` are not used."""
        start = np.concatenate([task.state, task.previous])
        if self._solution is None:
            self._solution = np.zeros(self._size)
            for node in self._nodes:
                self._solution[node] = start
        parameters = np.hstack([task.feedforward, task.disturbance, task.poses])
        given = np.concatenate([start, parameters.reshape(-1)])
        bounds = task.bounds
        result = self._solve(
            x0=self._solution,
            p=given,
            lbx=self._limits(bounds.lower, bounds.step_lower, -np.inf),
            ubx=self._limits(bounds.upper, bounds.step_upper, np.inf),
            lbg=0.0,
            ubg=0.0,
        )
        unknowns = np.asarray(result["x"]).reshape(-1)
        stats = self._solve.stats()
        success = bool(stats["success"])
        self._solution = unknowns if success else None
        errors = np.asarray(self._errors(unknowns, given)).T
        report = SolverReport(
            status="solved" if success else str(stats["return_status"]),
            accepted=success,
            iterations=int(stats.get("iter_count", 0)),
            solve_time_s=math.nan,
            primal_residual=float(np.abs(np.asarray(result["g"])).max()),
            dual_residual=math.nan,
        )
        if not success:
            return Plan(None, errors, report, f"{report.status}: previous feedback held")
        return Plan(np.concatenate([unknowns[step] for step in self._steps]), errors, report)

    def prepare(self) -> None:
        """Do nothing."""

    def fresh(self) -> Programme:
        """Return the programme before its first task; it shares CasADi's solver."""
        programme = copy.copy(self)
        programme._solution = None
        return programme

    def _limits(self, inputs: FloatArray, steps: FloatArray, free: float) -> FloatArray:
        """Return the limits of all unknowns from those of the free stages, (m Nc,) each."""
        limits = np.full(self._size, free)
        for j, step in enumerate(self._steps):
            limits[step] = steps[j * _M : (j + 1) * _M]
            limits[self._nodes[j + 1]][_N:] = inputs[j * _M : (j + 1) * _M]
        return limits
