"""A nonlinear MPC in CasADi, written against the interface of controllers alone.

    ttempc run grass --controller casadi_mpc:CasadiMpc
    ttempc bench casadi_mpc:CasadiMpc --quick

Needs `pip install casadi`. The model is the articulated vehicle of docs/architecture.md, with the
side slips, the steering bias and the drive disturbance of the estimate held over the horizon. With
a tool the point behind is the tool, as for the shipped controllers. The weights are the best of
some 50 settings forward and of 6 in reverse, in 500 runs of the benchmark's trials with tuning
seeds; the shipped controllers had 710 to 780.
"""

import casadi as ca
import numpy as np

from ttempc import Command
from ttempc.reference.reference import guided

STATES, INPUTS, DISTURBANCES = 7, 3, 5
REVERSE = 0.002, 0.2, 10.0, 1.0  # weights in reverse: less on the yaw angles ends in a jack-knife


def derivative(x, u, w, vehicle):
    """Return the time derivative (7,) of x, y, psi_t, psi_i, delta_t, delta_i, v."""
    _, _, psi_t, psi_i, delta_t, delta_i, v = ca.vertsplit(x)
    slip_t, slip_i, bias, drive, _ = ca.vertsplit(w)
    d, angle = vehicle.drawbar_length, psi_t - psi_i
    yaw_t = v * ca.tan(delta_t + bias) / vehicle.wheelbase
    rate_t = (u[0] - delta_t) / vehicle.steering_lag_t
    rate_i = (u[1] - delta_i) / vehicle.steering_lag_i
    across = v * (ca.sin(angle) + slip_t * ca.cos(angle) - slip_i)
    across -= vehicle.hitch_offset * yaw_t * ca.cos(angle)
    arm = vehicle.trailer_length + vehicle.trailer_turning_offset + d * ca.cos(delta_i)
    return ca.vertcat(
        v * (ca.cos(psi_t) - slip_t * ca.sin(psi_t)),
        v * (ca.sin(psi_t) + slip_t * ca.cos(psi_t)),
        yaw_t,
        (across - d * rate_i * ca.cos(delta_i)) / arm,
        rate_t,
        rate_i,
        (vehicle.speed_gain * u[2] - v) / vehicle.speed_time_constant + drive,
    )


def trailer_point(x, vehicle):
    """Return the trailer point (2,) of a state."""
    psi_d = x[3] + x[5]
    arms = ((vehicle.hitch_offset, x[2]), (vehicle.drawbar_length, psi_d))
    arms += ((vehicle.trailer_length, x[3]),)
    return x[:2] - sum(ca.vertcat(a * ca.cos(yaw), a * ca.sin(yaw)) for a, yaw in arms)


def step_of(vehicle, period_s):
    """Return the function (x, u, w) -> x after a period, by two steps of Runge and Kutta."""
    x, u, w = ca.SX.sym("x", STATES), ca.SX.sym("u", INPUTS), ca.SX.sym("w", DISTURBANCES)
    h, end = 0.5 * period_s, x
    for _ in range(2):
        k1 = derivative(end, u, w, vehicle)
        k2 = derivative(end + 0.5 * h * k1, u, w, vehicle)
        k3 = derivative(end + 0.5 * h * k2, u, w, vehicle)
        k4 = derivative(end + h * k3, u, w, vehicle)
        end = end + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return ca.Function("step", [x, u, w], [end])


class CasadiMpc:
    """Multiple shooting with Ipopt over `horizon` periods, started from the last plan."""

    def __init__(
        self,
        vehicle,
        reference,
        period_s,
        horizon=12,
        steering=0.045,
        moves=(1.8, 2.8, 2.8),
        trailer=140.0,
        heading=0.056,
    ):
        if vehicle.reverse:
            steering, moves, trailer, heading = REVERSE
        reference = guided(reference, "tool")
        vehicle = reference.vehicle
        self.horizon = horizon
        self.reference = reference.on_grid(period_s, beyond=horizon + 1)
        step = step_of(vehicle, period_s)
        x, u = ca.MX.sym("x", STATES, horizon + 1), ca.MX.sym("u", INPUTS, horizon)
        start, last = ca.MX.sym("start", STATES), ca.MX.sym("last", INPUTS)
        w = ca.MX.sym("w", DISTURBANCES)
        wanted = ca.MX.sym("wanted", STATES + 2 + INPUTS, horizon + 1)
        cost, gaps, changes = 0.0, [x[:, 0] - start], []
        for k in range(horizon):
            error = x[:, k + 1] - wanted[:STATES, k + 1]
            behind = trailer_point(x[:, k + 1], vehicle) - wanted[STATES : STATES + 2, k + 1]
            move = u[:, k] - (last if k == 0 else u[:, k - 1])
            own = u[:, k] - wanted[STATES + 2 :, k]
            cost += ca.sumsqr(error[:2]) + trailer * ca.sumsqr(behind)
            cost += heading * ca.sumsqr(error[2:4])
            change = move - self._change(wanted, k)
            cost += steering * ca.sumsqr(own) + ca.sumsqr(np.sqrt(moves) * change)
            gaps.append(x[:, k + 1] - step(x[:, k], u[:, k], w))
            changes.append(move)
        free = np.full(STATES * (horizon + 1), np.inf)
        limit = np.tile(vehicle.input_rate * period_s, horizon)
        zero = np.zeros(STATES * (horizon + 1))
        self.bounds = {
            "lbx": np.concatenate([-free, np.tile(vehicle.input_min, horizon)]),
            "ubx": np.concatenate([free, np.tile(vehicle.input_max, horizon)]),
            "lbg": np.concatenate([zero, -limit]),
            "ubg": np.concatenate([zero, limit]),
        }
        problem = {
            "x": ca.vertcat(ca.vec(x), ca.vec(u)),
            "p": ca.vertcat(start, last, w, ca.vec(wanted)),
            "f": cost,
            "g": ca.vertcat(*gaps, *changes),
        }
        quiet = {"print_level": 0, "sb": "yes", "max_iter": 30, "tol": 1e-4}
        options = {"print_time": False, "ipopt": quiet, "expand": True}
        self.solver = ca.nlpsol("mpc", "ipopt", problem, options)
        self.plan, self.last = None, self.reference.inputs[0]

    @staticmethod
    def _change(wanted, k):
        """Return the change of the reference's inputs before step k, which costs nothing."""
        inputs = wanted[STATES + 2 :, :]
        return inputs[:, k] - inputs[:, k - 1] if k else ca.MX.zeros(INPUTS)

    def step(self, estimate, k):
        """Return the command of control tick k."""
        grid, n = self.reference, self.horizon
        rows = slice(k, k + n + 1)
        state = grid.state[rows].copy()
        turns = np.round((estimate.state[2:4] - state[0, 2:4]) / (2.0 * np.pi))
        state[:, 2:4] += 2.0 * np.pi * turns  # yaw angles of the estimate may be turns apart
        wanted = np.hstack([state, grid.trailer_xy[rows], grid.inputs[rows]])
        guess = self.plan
        if guess is None:
            guess = np.concatenate([state.ravel(), grid.inputs[k : k + n].ravel()])
        given = np.concatenate([estimate.state, self.last, estimate.disturbance, wanted.ravel()])
        self.plan = np.asarray(self.solver(x0=guess, p=given, **self.bounds)["x"]).ravel()
        self.last = self.plan[STATES * (n + 1) :][:INPUTS]
        return Command(*self.last.tolist())
