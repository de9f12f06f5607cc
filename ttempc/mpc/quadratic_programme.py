"""Quadratic programme, with soft rows under an exact penalty."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from ..types import FloatArray

_ACTIVE = 1e-7  # slack below which a bound counts as active in `QP.residuals`
# Of a slack s: cost PENALTY s + PENALTY s^2 / 2. The penalty is exact, that is the slack is 0 where
# the hard problem has a solution, if it exceeds the sum of that problem's multipliers of the output
# (Kerrigan and Maciejowski 2000). Assumed: not proven to be exact. With 1 the slack exceeds 1 mm
# three times as often on `rows`; with 1000 noise of the estimate saturates the steering.
PENALTY: Final = 10.0
FREE: Final = 1e3
"""Bound in the place of an infinite one: of rows without a bound PIQP drops the coefficients."""
_HOLDS: Final = 1e-9  # violation that counts as none


@dataclass(frozen=True, slots=True)
class SoftRows:
    """Soft constraints of one QP: lower - s_j <= G x <= upper + s_j, for j = row modulo r.

    The rows are those of r outputs at one stage after the other. Each output has one slack s_j,
    its largest violation along the horizon.
    """

    matrix: FloatArray  # G (Np r, n)
    lower: FloatArray  # (Np r,)
    upper: FloatArray  # (Np r,)
    outputs: int  # r

    def hold(self, x: FloatArray) -> bool:
        """Whether all constraints hold at `x` (n,) without a slack."""
        rows = self.matrix @ x
        excess = np.maximum(rows - self.upper, self.lower - rows)
        return bool((excess <= _HOLDS).all())

    @property
    def slack_columns(self) -> FloatArray:
        """Return the matrix from the slacks to the rows, (Np r, r)."""
        return np.tile(np.eye(self.outputs), (len(self.lower) // self.outputs, 1))


@dataclass(frozen=True, slots=True)
class QPResiduals:
    """Residuals of the Karush-Kuhn-Tucker conditions of a QP at a point."""

    primal: float  # largest violation of a bound
    stationarity: float  # smallest |gradient of the Lagrangian| over admissible multipliers


@dataclass(frozen=True, slots=True)
class QP:
    """Minimise 1/2 x'Hx + g'x subject to lower <= G x <= upper, step_lower <= x <= step_upper."""

    hessian: FloatArray  # H (n, n)
    gradient: FloatArray  # g (n,)
    matrix: FloatArray  # G (m, n)
    lower: FloatArray  # (m,)
    upper: FloatArray  # (m,)
    step_lower: FloatArray  # (n,)
    step_upper: FloatArray  # (n,)
    soft: SoftRows | None = None  # further rows, which only `hardened` takes into account

    def hardened(self) -> QP:
        """Return the problem in (x, s) with the slacks s of its soft rows, whose bounds are hard.

        Without soft rows it is this problem.
        """
        soft = self.soft
        if soft is None:
            return self
        n, r = len(self.gradient), soft.outputs
        hessian = PENALTY * np.eye(n + r)
        hessian[:n, :n] = self.hessian
        slack = soft.slack_columns
        return QP(
            hessian=hessian,
            gradient=np.concatenate([self.gradient, np.full(r, PENALTY)]),
            matrix=np.block(
                [
                    [self.matrix, np.zeros((len(self.matrix), r))],
                    [soft.matrix, -slack],
                    [-soft.matrix, -slack],
                ]
            ),
            lower=np.concatenate([self.lower, np.full(2 * len(soft.lower), -np.inf)]),
            upper=np.concatenate([self.upper, soft.upper, -soft.lower]),
            step_lower=np.concatenate([self.step_lower, np.zeros(r)]),
            step_upper=np.concatenate([self.step_upper, np.full(r, np.inf)]),
        )

    def objective(self, x: FloatArray) -> float:
        """Return the cost at `x` (n,)."""
        return float(0.5 * x @ self.hessian @ x + self.gradient @ x)

    def slack(self, x: FloatArray) -> FloatArray:
        """Return the distances of `x` (n,) to all bounds, negative beyond one, (2 m + 2 n,).

        In the order upper, lower, step_upper, step_lower.
        """
        rows = self.matrix @ x
        return np.concatenate(
            [self.upper - rows, rows - self.lower, self.step_upper - x, x - self.step_lower]
        )

    def residuals(self, x: FloatArray) -> QPResiduals:
        """Return by how much `x` (n,) misses the optimality conditions; no solver is involved."""
        rows = np.vstack([self.matrix, -self.matrix, np.eye(len(x)), -np.eye(len(x))])
        slack = self.slack(x)
        slope = self.hessian @ x + self.gradient
        active = slack < _ACTIVE
        # Optimal means -slope = sum of active rows with multipliers >= 0.
        rest = float(np.linalg.norm(slope))
        if active.any():
            rest = scipy.optimize.nnls(rows[active].T, -slope)[1]
        return QPResiduals(primal=float(max(0.0, -slack.min())), stationarity=float(rest))
