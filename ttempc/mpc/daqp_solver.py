"""DAQP's dual active-set solver.

Arnstroem, Bemporad and Axehill (2022), "A dual active-set solver for embedded quadratic programming
using recursive LDL' updates", IEEE Transactions on Automatic Control 67(8).
"""

from __future__ import annotations

import math
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from ..errors import MissingPackage
from ..types import FloatArray, SolverReport
from .quadratic_programme import QP

_SETTINGS: Final = MappingProxyType({"primal_tol": 1e-11, "dual_tol": 1e-12})
# Exit flags of DAQP's documentation.
_FAILURES: Final = MappingProxyType(
    {
        -1: "primal infeasible",
        -2: "cycling detected",
        -3: "unbounded",
        -4: "max iter reached",
        -5: "hessian not convex",
        -6: "initial active set overdetermined",
        -7: "time limit reached",
    }
)


class DaqpSolver:
    """See `ttempc.mpc.solver.QPSolver`; each problem starts from an empty active set.

    Raises:
        MissingPackage: DAQP is not installed.
    """

    def __init__(self) -> None:
        try:
            import daqp
        except ImportError:
            raise MissingPackage(
                "the QP solver DAQP is not installed: pip install 'ttempc[baselines]', or set "
                "controller.options.solver to 'piqp'"
            ) from None
        self._package = daqp
        self._model: Any = None
        self._held = b""  # the Hessian in the model, by its bytes
        self._matrix: FloatArray = np.empty((0, 0))  # of the rows in the model

    def hold(self, hessian: FloatArray) -> None:
        """Factorise the Hessian (n, n) of the next problem, unless the model holds it."""
        # Always apart from gradient and bounds, so that the time of it changes no bit of a result.
        if self._model is None or len(hessian) != self._matrix.shape[1]:
            return
        if (content := hessian.tobytes()) != self._held:
            self._model.update(H=np.ascontiguousarray(hessian))
            self._held = content

    def solve(self, qp: QP) -> tuple[FloatArray, SolverReport]:
        """Return the minimiser (n,), or an arbitrary point, and DAQP's report."""
        lower = np.concatenate([qp.step_lower, qp.lower])
        upper = np.concatenate([qp.step_upper, qp.upper])
        # The rows of the inputs are one array for all ticks; soft rows are new ones at each tick.
        known, self._matrix = self._matrix, qp.matrix
        if self._model is None or known.shape != qp.matrix.shape:
            self._model, self._held = self._package.Model(), b""
            flag, _ = self._model.setup(
                np.ascontiguousarray(qp.hessian),
                qp.gradient,
                np.ascontiguousarray(qp.matrix),
                upper,
                lower,
            )
            if flag < 0:
                return qp.gradient, _report(flag, 0, 0.0)
            self._model.settings = dict(_SETTINGS)
        elif qp.matrix is not known:
            self._model.update(A=np.ascontiguousarray(qp.matrix))
        self.hold(qp.hessian)
        # Without `sense` it starts from the last active set, and the last bits of a result depend
        # on the problems before.
        empty = np.zeros(len(upper), dtype=np.intc)
        self._model.update(f=qp.gradient, bupper=upper, blower=lower, sense=empty)
        x, _, flag, info = self._model.solve()
        return np.asarray(x), _report(flag, info["iterations"], info["solve_time"])


def _report(flag: int, iterations: int, solve_time_s: float) -> SolverReport:
    accepted = flag > 0
    status = "solved" if accepted else _FAILURES.get(flag, f"daqp exit flag {flag}")
    return SolverReport(status, accepted, iterations, solve_time_s, math.nan, math.nan)
