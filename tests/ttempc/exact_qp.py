"""Exact minimiser and optimality conditions of small quadratic programmes, by no QP solver."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from ttempc.mpc.qp import QP
from ttempc.types import FloatArray


def exact_minimum(qp: QP) -> FloatArray:
    """Return the minimiser (n,), by Hildreth's iteration on the dual for the active set."""
    n = len(qp.gradient)
    rows = np.vstack([qp.matrix, np.eye(n), -qp.matrix, -np.eye(n)])
    limits = np.concatenate([qp.row_upper, qp.upper, -qp.row_lower, -qp.lower])
    rows = rows[np.isfinite(limits)]
    limits = limits[np.isfinite(limits)]
    inverse = np.linalg.inv(qp.hessian)
    # Dual: minimise 1/2 m'Dm + e'm over m >= 0, one coordinate after the other.
    dual = rows @ inverse @ rows.T
    linear = limits + rows @ inverse @ qp.gradient
    multipliers = np.zeros(len(limits))
    for _ in range(20_000):
        before = multipliers.copy()
        for i in range(len(limits)):
            step = (linear[i] + dual[i] @ multipliers) / dual[i, i]
            multipliers[i] = max(0.0, multipliers[i] - step)
        if np.max(np.abs(multipliers - before)) < 1e-13:
            break
    active = multipliers > 1e-9
    # With the active rows known, the minimiser is a linear solve.
    count = int(active.sum())
    kkt = np.block([[qp.hessian, rows[active].T], [rows[active], np.zeros((count, count))]])
    right = np.concatenate([-qp.gradient, limits[active]])
    return np.linalg.lstsq(kkt, right, rcond=None)[0][:n]


def residuals(qp: QP, x: FloatArray) -> tuple[float, float]:
    """Return the largest violation of a bound at `x` (n,), and how far it is from stationary."""
    rows = np.vstack([-qp.matrix, -np.eye(len(x)), qp.matrix, np.eye(len(x))])
    values = qp.matrix @ x
    slope = qp.hessian @ x + qp.gradient
    below = (values - qp.row_lower, x - qp.lower)
    above = (qp.row_upper - values, qp.upper - x)
    slack = np.concatenate([*below, *above])
    active = slack < 1e-7  # -slope must be a sum of active rows with multipliers >= 0
    rest = nnls(rows[active].T, -slope)[1] if active.any() else np.linalg.norm(slope)
    return float(max(0.0, -slack.min())), float(rest)
