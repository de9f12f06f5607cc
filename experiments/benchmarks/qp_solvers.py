"""Time and accuracy of both QP solvers on QPs of runs.

    python -m experiments.benchmarks.qp_solvers

The QPs are those of `ttempc` in a lap of each field; only those with active bounds count, since the
others need no solver. Times are of a whole solve with its checks, the fastest of several replays.
With the Hessian held, its factorisation is done before, as by `prepare` between two ticks.
Differences are those to DAQP's minimiser in the first move and in all moves [rad, fraction of the
hydrostat]; its own accuracy is that of the optimality conditions.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np

from ttempc.mpc.lmpc import SOLVERS
from ttempc.mpc.qp import QP, PersistentSolver, QPSolution
from ttempc.types import FloatArray

from ..run.simulate import simulate
from ..scenario.scenario import load

FIELDS = ("grass", "wet-slope", "patchy", "old-valves", "furrows")
LAP = "path.laps=1"
SEED = 90
REPEATS = 4


@contextmanager
def recording(qps: list[QP]) -> Iterator[None]:
    """Append every QP to `qps` that a solver is called for."""
    solve = PersistentSolver.solve

    def recorded(solver: PersistentSolver, qp: QP) -> QPSolution:
        solution = solve(solver, qp)
        if solution.report.iterations:
            qps.append(qp)
        return solution

    with patch.object(PersistentSolver, "solve", recorded):
        yield


def replayed(qps: list[QP], name: str, held: bool) -> tuple[FloatArray, FloatArray]:
    """Return times (N,) [s] and minimisers (N, n), NaN where a QP was not solved."""
    solver = PersistentSolver(name)
    times, minimisers = np.empty(len(qps)), np.full((len(qps), len(qps[0].gradient)), np.nan)
    for k, qp in enumerate(qps):
        if held:
            solver.hold(qp.hessian)
        begin = time.thread_time()
        solution = solver.solve(qp)
        times[k] = time.thread_time() - begin
        if solution.x is not None:
            minimisers[k] = solution.x
    return times, minimisers


def main() -> None:
    """Print times, failures and differences of every solver."""
    qps: list[QP] = []
    for field in FIELDS:
        with recording(qps):
            simulate(*load(field, [LAP]), SEED)
    _, exact = replayed(qps, "daqp", held=False)
    rest = [qp.residuals(x).stationarity for qp, x in zip(qps, exact, strict=True)]
    print(f"{len(qps)} QPs; DAQP misses the optimality conditions by {max(rest):.1e} at most")
    heads = "median us", "p99 us", "not solved", "first move", "all moves"
    print(f"{'':14s}" + "".join(f"{head:>12s}" for head in heads))
    for name in SOLVERS:
        for held in (False, True) if name == "daqp" else (False,):
            runs = [replayed(qps, name, held) for _ in range(REPEATS)]
            times_us = 1e6 * np.min([times for times, _ in runs], axis=0)
            off = np.abs(runs[0][1] - exact)
            print(
                f"{name + ', held' * held:14s}{np.median(times_us):12.1f}"
                f"{np.quantile(times_us, 0.99):12.1f}{np.isnan(off).any(axis=1).sum():12d}"
                f"{np.nanmax(off[:, :3]):12.1e}{np.nanmax(off):12.1e}"
            )


if __name__ == "__main__":
    main()
