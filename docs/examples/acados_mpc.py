"""The nonlinear MPC of `casadi_mpc.py`, its solver generated as C by acados.

    ttempc run grass --controller acados_mpc:AcadosMpc

Needs a C compiler, make, `pip install casadi` and acados with its Python package, here from
`pip install --no-deps comma-deps-acados` (without the CasADi in it). Real-time iterations with
Gauss-Newton and HPIPM, two a period; a solver is generated once for a vehicle, in a second.
"""

import ctypes
import functools
import os
import tempfile
from pathlib import Path

import acados
import casadi as ca
import numpy as np
from acados.acados_template import AcadosModel, AcadosOcp, AcadosOcpSolver
from casadi_mpc import DISTURBANCES, INPUTS, REVERSE, STATES, step_of, trailer_point

from ttempc import Command

ROUNDS = 2  # real-time iterations of a period


@functools.cache
def installed():
    """Lay out the files of the wheel as those of a source tree, which the templates expect."""
    folder = Path(tempfile.mkdtemp(prefix="acados"))
    for name in ("lib", "include", "bin"):
        (folder / name).symlink_to(Path(acados.DIR) / name)
    inside = folder / "interfaces" / "acados_template"
    inside.mkdir(parents=True)
    (inside / "acados_template").symlink_to(acados.TEMPLATE_DIR)
    for name in ("libblasfeo.so", "libhpipm.so", "libqpOASES_e.so", "libacados.so"):
        ctypes.CDLL(str(folder / "lib" / name), mode=ctypes.RTLD_GLOBAL)
    os.environ.update(ACADOS_SOURCE_DIR=str(folder), TERA_PATH=acados.TERA_PATH)


@functools.cache
def generated(vehicle, period_s, horizon, weights):
    """Return problem and file of a compiled solver: x with the last input, u its change."""
    installed()
    steering, moves, trailer, heading = weights
    x, u = ca.SX.sym("x", STATES + INPUTS), ca.SX.sym("u", INPUTS)
    w, change = ca.SX.sym("w", DISTURBANCES), ca.SX.sym("change", INPUTS)
    wanted, sent = ca.SX.sym("wanted", STATES + 2 + INPUTS), x[STATES:] + u
    behind = trailer_point(x[:STATES], vehicle) - wanted[STATES : STATES + 2]
    place = ca.vertcat(x[:2] - wanted[:2], behind, x[2:4] - wanted[2:4])
    folder = tempfile.mkdtemp(prefix="acados")
    ocp, model = AcadosOcp(), AcadosModel()
    model.name = "mpc" + Path(folder).name.replace("-", "_")  # of the library: one for a process
    model.x, model.u, model.p = x, u, ca.vertcat(w, wanted, change)
    model.disc_dyn_expr = ca.vertcat(step_of(vehicle, period_s)(x[:STATES], sent, w), sent)
    model.cost_y_expr_0, model.cost_y_expr_e = u - change, place
    model.cost_y_expr = ca.vertcat(place, x[STATES:] - wanted[STATES + 2 :], u - change)
    ocp.model, ocp.dims.N, ocp.solver_options.tf = model, horizon, horizon * period_s
    cost, bounds, options = ocp.cost, ocp.constraints, ocp.solver_options
    cost.cost_type = cost.cost_type_0 = cost.cost_type_e = "NONLINEAR_LS"
    where = [1.0, 1.0, trailer, trailer, heading, heading]
    cost.W_0, cost.W_e = np.eye(3) * moves / period_s, np.diag(where)
    cost.W = np.diag([*where, *[steering] * 3, *[moves] * 3]) / period_s  # acados integrates it
    cost.yref_0, cost.yref, cost.yref_e = np.zeros(3), np.zeros(12), np.zeros(6)
    limit = np.asarray(vehicle.input_rate) * period_s
    bounds.idxbu, bounds.lbu, bounds.ubu = np.arange(3), -limit, limit
    bounds.idxbx = bounds.idxbx_e = np.arange(STATES, STATES + INPUTS)
    bounds.lbx = bounds.lbx_e = np.array(vehicle.input_min)
    bounds.ubx = bounds.ubx_e = np.array(vehicle.input_max)
    bounds.x0, ocp.parameter_values = np.zeros(x.numel()), np.zeros(model.p.numel())
    options.qp_solver, options.nlp_solver_type = "PARTIAL_CONDENSING_HPIPM", "SQP_RTI"
    options.hessian_approx, options.integrator_type = "GAUSS_NEWTON", "DISCRETE"
    ocp.code_export_directory, file = f"{folder}/code", f"{folder}/ocp.json"
    AcadosOcpSolver(ocp, json_file=file, verbose=False)
    return ocp, file


class AcadosMpc:
    """Multiple shooting over `horizon` periods, started from the last plan a period later."""

    def __init__(
        self,
        vehicle,
        reference,
        period_s,
        horizon=12,
        steering=0.018,
        moves=2.8,
        trailer=140.0,
        heading=0.056,
    ):
        self.grid, self.horizon = reference.on_grid(period_s, beyond=horizon + 1), horizon
        weights = REVERSE if vehicle.reverse else (steering, moves, trailer, heading)
        ocp, file = generated(vehicle, period_s, horizon, weights)
        old = {"generate": False, "build": False, "verbose": False}
        self.solver, self.begun = AcadosOcpSolver(ocp, json_file=file, **old), False
        self.last = self.grid.inputs[0]

    def step(self, estimate, k):
        """Return the command of control tick k."""
        grid, n, solver = self.grid, self.horizon, self.solver
        turns = 2.0 * np.pi * np.round((estimate.state[2:4] - grid.state[k, 2:4]) / (2.0 * np.pi))
        start = np.concatenate([estimate.state, self.last])
        for i in range(n + 1):
            state, before = grid.state[k + i].copy(), grid.inputs[max(k + i - 1, 0)]
            state[2:4] += turns
            change = grid.inputs[k + i] - before if i else np.zeros(INPUTS)
            given = (estimate.disturbance, state, grid.trailer_xy[k + i], before, change)
            solver.set(i, "p", np.concatenate(given))
            if not self.begun:
                solver.set(i, "x", np.concatenate([state, before]))
            elif i < n - 1:
                for name in ("x", "u"):
                    solver.set(i, name, solver.get(i + 1, name))
        self.begun = True
        for bound in ("lbx", "ubx"):
            solver.set(0, bound, start)
        for _ in range(ROUNDS):
            solver.solve()
        self.last = self.last + solver.get(0, "u")
        return Command(*self.last.tolist())
