"""Exact minimiser of small quadratic programmes, independent of PIQP."""

from __future__ import annotations

import numpy as np

from ttempc.mpc.qp import QP
from ttempc.types import FloatArray


def exact_minimum(qp: QP) -> FloatArray:
    """Return the minimiser (n,), by Hildreth's iteration on the dual for the active set."""
    n = len(qp.gradient)
    rows = np.vstack([qp.matrix, -qp.matrix, np.eye(n), -np.eye(n)])
    limits = np.concatenate([qp.upper, -qp.lower, qp.step_upper, -qp.step_lower])
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
