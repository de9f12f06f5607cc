"""Sparse nonlinear programme of the NMPC, for CasADi's own solvers.

`ttempc.baselines.nmpc_solver` condenses the same problem to its free input steps. Here every
state is an unknown (multiple shooting), in the order of solvers for optimal control.
"""

from __future__ import annotations

import copy
import math
from typing import Any, Final

import numpy as np

from ttempc.baselines.nmpc_model import WHOLE, ArticulatedExpressions, Subsystem, load_casadi
from ttempc.baselines.nmpc_solver import Plan, Task
from ttempc.errors import InvalidTuning
from ttempc.mpc.qp import HorizonTuning
from ttempc.reference.reference import Reference
from ttempc.types import Disturbance, FloatArray, Input, SolverReport, State

_N, _M, _D = len(State), len(Input), len(Disturbance)
_NODE = _N + _M  # a state and the u_e that led there
_GIVEN = _M + _D + 6  # of a period: feedforward, disturbance, poses of the reference at its end

_COMMON: Final = {"print_time": False, "record_time": True, "expand": True}
_QUIET: Final = {"print_header": False, "print_iteration": False, "print_status": False}
SOLVERS: Final[dict[str, dict[str, Any]]] = {
    "ipopt": {**_COMMON, "ipopt": {"print_level": 0, "sb": "yes"}},
    "fatrop": {**_COMMON, "structure_detection": "auto", "fatrop": {"print_level": 0}},
    "sqpmethod": {
        **_COMMON,
        **_QUIET,
        "qpsol": "qrqp",
        "qpsol_options": {"print_iter": False, "print_header": False, "error_on_fail": False},
    },
}
"""Options of CasADi's solvers by name."""


class Programme:
    """Nonlinear programme in (x_0, u_e,-1), Delta u_e,0, (x_1, u_e,0), ...; steps in Nc periods."""

    def __init__(
        self,
        reference: Reference,
        subsystem: Subsystem,
        tuning: HorizonTuning,
        period_s: float,
        solver: str,
    ) -> None:
        if subsystem is not WHOLE:
            raise InvalidTuning("subsystem: the programme covers the whole vehicle only")
        ca = load_casadi()
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
        options = dict(SOLVERS[solver])
        if "structure_detection" in options:
            options["equality"] = [True] * constraints.numel()
        problem = {"x": unknowns, "f": cost, "g": constraints, "p": given}
        self._solve = ca.nlpsol("programme", solver, problem, options)
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
            solve_time_s=float(stats["t_wall_total"]),
            primal_residual=float(np.abs(np.asarray(result["g"])).max()),
            dual_residual=math.nan,
        )
        if not success:
            return Plan(None, errors, report, f"{report.status}: previous feedback held")
        return Plan(np.concatenate([unknowns[step] for step in self._steps]), errors, report)

    def prepare(self) -> None:
        """Do nothing: the benchmark measures with warm caches."""

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
