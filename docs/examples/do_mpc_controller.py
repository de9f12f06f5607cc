"""A nonlinear MPC with do-mpc, written against the interface of controllers alone.

    ttempc run grass --controller do_mpc_controller:DoMpc
    ttempc bench do_mpc_controller:DoMpc --quick

Needs `pip install do-mpc`. Model, weights and budget of tuning are those of `casadi_mpc.py` beside
it. do-mpc weighs changes of its inputs from 0: its inputs are therefore the differences of the
commands from those of the reference.
"""

import do_mpc
import numpy as np
from casadi_mpc import DISTURBANCES, INPUTS, REVERSE, STATES, step_of, trailer_point

from ttempc import Command
from ttempc.reference.reference import guided


class DoMpc:
    """do-mpc over `horizon` periods; the reference and the disturbances are its parameters."""

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
        self.reference = reference.on_grid(period_s, beyond=horizon + 1)
        model = do_mpc.model.Model("discrete")
        x = model.set_variable("_x", "x", (STATES, 1))
        last = model.set_variable("_x", "last", (INPUTS, 1))
        own = model.set_variable("_u", "own", (INPUTS, 1))
        given = model.set_variable("_tvp", "given", (STATES + 2 + INPUTS + DISTURBANCES, 1))
        wanted, point = given[:STATES], given[STATES : STATES + 2]
        inputs, w = given[STATES + 2 : STATES + 2 + INPUTS], given[STATES + 2 + INPUTS :]
        model.set_rhs("x", step_of(vehicle, period_s)(x, inputs + own, w))
        model.set_rhs("last", inputs + own)
        error, behind = x - wanted, trailer_point(x, vehicle) - point
        place = error[:2].T @ error[:2] + trailer * (behind.T @ behind)
        model.set_expression("place", place + heading * (error[2:4].T @ error[2:4]))
        model.set_expression("own", own.T @ own)
        model.set_expression("command", inputs + own)
        model.set_expression("change", inputs + own - last)
        model.setup()
        place, own, command, change = (model.aux[n] for n in ("place", "own", "command", "change"))
        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = horizon, period_s
        mpc.settings.store_full_solution = False
        mpc.settings.nlpsol_opts = {"ipopt.max_iter": 30, "ipopt.tol": 1e-4, "expand": True}
        mpc.settings.supress_ipopt_output()
        mpc.set_objective(mterm=place, lterm=place + steering * own)
        mpc.set_rterm(own=np.broadcast_to(moves, INPUTS).reshape(-1, 1))
        mpc.set_nl_cons("highest", command, vehicle.input_max)
        mpc.set_nl_cons("lowest", -command, -vehicle.input_min)
        mpc.set_nl_cons("up", change, vehicle.input_rate * period_s)
        mpc.set_nl_cons("down", -change, vehicle.input_rate * period_s)
        self.template, self.horizon = mpc.get_tvp_template(), horizon
        self.k, self.estimate = 0, None
        mpc.set_tvp_fun(self._parameters)
        mpc.setup()
        self.mpc, self.begun, self.last = mpc, False, self.reference.inputs[0]

    def _parameters(self, time_s):
        """Return reference and disturbances over the horizon, yaw near that of the estimate."""
        grid, estimate = self.reference, self.estimate
        for n in range(self.horizon + 1):
            state = grid.state[self.k + n].copy()
            w = np.zeros(DISTURBANCES) if estimate is None else estimate.disturbance
            if estimate is not None:
                turns = np.round((estimate.state[2:4] - grid.state[self.k, 2:4]) / (2.0 * np.pi))
                state[2:4] += 2.0 * np.pi * turns
            parts = (state, grid.trailer_xy[self.k + n], grid.inputs[self.k + n], w)
            self.template["_tvp", n, "given"] = np.concatenate(parts)
        return self.template

    def step(self, estimate, k):
        """Return the command of control tick k."""
        self.k, self.estimate = k, estimate
        state = np.concatenate([estimate.state, self.last])
        if not self.begun:
            self.mpc.x0 = state
            self.mpc.set_initial_guess()
            self.begun = True
        own = self.mpc.make_step(state.reshape(-1, 1)).ravel()
        self.last = self.reference.inputs[k] + own
        return Command(*self.last.tolist())
