"""Quadratic programmes along the figure eight, for tests of `ttempc.mpc`."""

from __future__ import annotations

from functools import cache

import numpy as np

from ttempc.baselines.paper import PaperEquations, linearise
from ttempc.models.linear import zero_order_hold
from ttempc.mpc.condensing import solve_in_closed_form
from ttempc.mpc.lmpc import CondensedHorizon, HorizonTuning
from ttempc.mpc.qp import QP
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
TUNING = HorizonTuning()


@cache
def stages() -> tuple[FloatArray, FloatArray]:
    """Return A_d (N, 7, 7) and B_d (N, 7, 3) of the first 30 s of the figure eight."""
    reference = Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0))
    sample = reference.at(np.arange(0.0, 30.0, PERIOD_S))
    return zero_order_hold(*linearise(sample, Vehicle(), PaperEquations()), PERIOD_S)


@cache
def horizon() -> CondensedHorizon:
    return CondensedHorizon(*stages(), TUNING, PERIOD_S)


def qp_of(horizon: CondensedHorizon, k: int, state: FloatArray, previous: FloatArray) -> QP:
    """Return the QP of tick `k` for z_k (n,) and u_{k-1} (m,), with its soft rows."""
    work = horizon.work()
    work.state[:] = state
    work.previous[:] = previous
    solve_in_closed_form(k, horizon.stages, work)
    if len(horizon.stages.soft_penalty):
        return horizon.softened_problem(k, work)
    return horizon.problem(work)


def random_qp(generator: np.random.Generator, scale: float) -> tuple[QP, FloatArray, FloatArray]:
    """Return a random QP, its state (7,) and its previous input (3,)."""
    state = scale * generator.normal(size=7)
    bound = np.asarray(TUNING.input_bound)
    previous = bound * generator.uniform(-1.0, 1.0, size=3)
    k = int(generator.integers(horizon().ticks))
    return qp_of(horizon(), k, state, previous), state, previous
