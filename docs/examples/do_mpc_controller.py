"""A nonlinear MPC with do-mpc, written against the interface of controllers alone.

    ttempc run grass --controller do_mpc_controller:DoMpc
    ttempc bench do_mpc_controller:DoMpc --quick

Needs `pip install do-mpc`. The model is that of `casadi_mpc.py` beside it; do-mpc discretises it by
collocation and solves with Ipopt. The weights are untuned: those of `casadi_mpc.py` did worse here
on the seeds 1 to 3 of the trials `wet-slope` and `tool`.
"""

import do_mpc
import numpy as np
from casadi_mpc import DISTURBANCES, INPUTS, STATES, derivative, trailer_point

from ttempc import Command


class DoMpc:
    """do-mpc over `horizon` periods; the reference and the disturbances are its parameters."""

    def __init__(
        self,
        vehicle,
        reference,
        period_s,
        horizon=12,
        steering=0.1,
        moves=1.0,
        trailer=1.0,
        heading=0.1,
    ):
        self.reference = reference.on_grid(period_s, beyond=horizon + 1)
        model = do_mpc.model.Model("continuous")
        x = model.set_variable("_x", "x", (STATES, 1))
        u = model.set_variable("_u", "u", (INPUTS, 1))
        given = model.set_variable("_tvp", "given", (STATES + 2 + INPUTS + DISTURBANCES, 1))
        wanted, point = given[:STATES], given[STATES : STATES + 2]
        inputs, w = given[STATES + 2 : STATES + 2 + INPUTS], given[STATES + 2 + INPUTS :]
        model.set_rhs("x", derivative(x, u, w, vehicle))
        error, behind = x - wanted, trailer_point(x, vehicle) - point
        own = u - inputs
        place = error[:2].T @ error[:2] + trailer * (behind.T @ behind)
        place += heading * (error[2:4].T @ error[2:4])
        model.set_expression("place", place)
        model.set_expression("own", own.T @ own)
        model.setup()
        place, own = model.aux["place"], model.aux["own"]
        mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = horizon, period_s
        mpc.settings.collocation_deg = 2
        mpc.settings.store_full_solution = False
        mpc.settings.nlpsol_opts = {"ipopt.max_iter": 30, "ipopt.tol": 1e-4}
        mpc.settings.supress_ipopt_output()
        mpc.set_objective(mterm=place, lterm=place + steering * own)
        mpc.set_rterm(u=np.full((INPUTS, 1), moves))
        mpc.bounds["lower", "_u", "u"] = vehicle.input_min
        mpc.bounds["upper", "_u", "u"] = vehicle.input_max
        self.template, self.horizon = mpc.get_tvp_template(), horizon
        self.k, self.estimate = 0, None
        mpc.set_tvp_fun(self._parameters)
        mpc.setup()
        self.mpc, self.begun = mpc, False

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
        if not self.begun:
            self.mpc.x0, self.mpc.u0 = estimate.state, self.reference.inputs[k]
            self.mpc.set_initial_guess()
            self.begun = True
        return Command(*self.mpc.make_step(estimate.state.reshape(-1, 1)).ravel().tolist())
