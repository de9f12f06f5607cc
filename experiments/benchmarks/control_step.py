"""Cost of a control step, by part.

Replays the estimates of half a lap of the figure eight to supervisor and controller, back to back.
Every step, and every part of it, counts with its fastest of several replays, which reduces the
effect of other processes. The figures are medians over the steps.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Any, Final
from unittest.mock import patch

import numpy as np
from scipy.integrate import solve_ivp

from ttempc.guidance.controllers import make_controller
from ttempc.guidance.supervisor import SafetyLimits, Supervisor
from ttempc.laws.articulated_mpc import ArticulatedFeedback, OneStepMonitor
from ttempc.laws.lq_robust_law import LqRobustLaw
from ttempc.laws.tracking_controller import TrackingController
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point
from ttempc.mpc.articulated_error import PredictedPath
from ttempc.mpc.lmpc import CondensedHorizon
from ttempc.mpc.qp import PersistentSolver
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate, FloatArray
from ttempc.vehicle import Vehicle

from .figure import BenchmarkFigure, Limit

PERIOD_S: Final = 0.2
TICKS = 340  # half a lap at 1 m/s
SEED: Final = 1
NOISE: Final = np.array([0.01, 0.01, 0.005, 0.005, 0.002, 0.002, 0.01])  # m, rad, m/s
REPEATS = 40

LARGEST_OVER_QP_US: Final = 25.0
LARGEST_WITHOUT_SOLVER_US: Final = 40.0

_QP: Final = "QP"
_PARTS: Final[dict[str, tuple[tuple[type, str], ...]]] = {
    "supervisor and command guard": ((Supervisor, "step"),),
    "feedforward, limits, diagnostics": ((TrackingController, "step"),),
    "QP matrices": ((CondensedHorizon, "qp"),),
    _QP: ((PersistentSolver, "solve"),),
    "robust law": ((LqRobustLaw, "step"), (LqRobustLaw, "record_feedback")),
    "predicted path and one-step monitor": ((PredictedPath, "of"), (OneStepMonitor, "report")),
    "rest of the feedback law": ((ArticulatedFeedback, "step"),),
}
"""Methods by the part in which they count, what they call of other parts apart."""


class _PartClock:
    """Time spent in each part, without the parts that it calls."""

    def __init__(self) -> None:
        self.spent: defaultdict[str, float] = defaultdict(float)  # [s]
        self._inner_s: list[float] = []  # of the parts called by each part that is under way

    @contextmanager
    def running(self) -> Iterator[None]:
        """Let the methods of all parts count."""
        with ExitStack() as stack:
            for part, methods in _PARTS.items():
                for owner, name in methods:
                    timed = self._timed(part, getattr(owner, name))
                    stack.enter_context(patch.object(owner, name, timed))
            yield

    def _timed(self, part: str, method: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **keywords: Any) -> Any:  # noqa: ANN401 - of any method
            self._inner_s.append(0.0)
            begin = time.perf_counter()
            result = method(*arguments, **keywords)
            taken = time.perf_counter() - begin
            self.spent[part] += taken - self._inner_s.pop()
            if self._inner_s:
                self._inner_s[-1] += taken
            return result

        return timed


def default_reference() -> tuple[Vehicle, Reference]:
    """Return the default vehicle and a figure eight at 1 m/s."""
    vehicle = Vehicle()
    return vehicle, Reference(figure_eight(), vehicle, ConstantSpeed(1.0))


def estimates_along(name: str, vehicle: Vehicle, reference: Reference) -> list[Estimate]:
    """Return the estimates of a controller along half a lap, on the kinematic model."""
    controller = make_controller(name, vehicle, reference, PERIOD_S)
    generator = np.random.default_rng(SEED)
    state = reference.at(0.0).state
    estimates = []
    for k in range(TICKS):
        noisy = state + NOISE * generator.standard_normal(7)
        estimate = Estimate(
            time_s=k * PERIOD_S,
            state=noisy,
            covariance=np.diag(NOISE**2),
            trailer_xy=trailer_point(noisy, vehicle),
            hitch_angle=hitch_angle(noisy),
        )
        estimates.append(estimate)
        command = controller.step(estimate, k).command.as_array()
        state = solve_ivp(
            lambda _, x, u=command: articulated(x, u, vehicle), (0.0, PERIOD_S), state
        ).y[:, -1]
    return estimates


def timed(
    controller: TrackingController,
    estimates: Sequence[Estimate],
    pause_s: float = 0.0,
    prepared: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Return the times of whole steps [s] and their solver iterations, (N,) each."""
    steps, iterations = np.zeros(len(estimates)), np.zeros(len(estimates))
    for k, estimate in enumerate(estimates):
        if pause_s:
            time.sleep(pause_s)
        if prepared:
            controller.prepare(k)
        begin = time.perf_counter()
        result = controller.step(estimate, k)
        steps[k] = time.perf_counter() - begin
        report = result.diagnostics.solver
        iterations[k] = report.iterations if report else 0
    return steps, iterations


def figures() -> list[BenchmarkFigure]:
    """Return the medians of whole steps of `ttempc` and of their parts, of PIQP's ticks apart."""
    vehicle, reference = default_reference()
    estimates = estimates_along("ttempc", vehicle, reference)
    wholes, parts = [], []
    solved = np.zeros(len(estimates), dtype=bool)
    for _ in range(REPEATS):
        controller = make_controller("ttempc", vehicle, reference, PERIOD_S)
        supervisor = Supervisor(controller, reference, PERIOD_S, SafetyLimits())
        steps, clock = [], _PartClock()
        with clock.running():
            for k, estimate in enumerate(estimates):
                clock.spent.clear()
                supervisor.step(estimate, k, estimate.time_s)
                steps.append([clock.spent[part] for part in _PARTS])
        parts.append(steps)
        whole, iterations = timed(
            make_controller("ttempc", vehicle, reference, PERIOD_S), estimates
        )
        wholes.append(whole)
        solved = iterations > 0
    whole_us = 1e6 * np.min(wholes, axis=0)
    parts_us = 1e6 * np.min(parts, axis=0)
    solved[0] = False  # sets the solver up
    rest = ~solved
    rest[0] = False
    qp_us = parts_us[:, list(_PARTS).index(_QP)]

    def row(name: str, values: FloatArray, limit: Limit | None = None) -> BenchmarkFigure:
        return BenchmarkFigure(name, float(np.median(values)), "us", limit)

    over, without = Limit(LARGEST_OVER_QP_US), Limit(LARGEST_WITHOUT_SOLVER_US)
    result = [
        row("`ttempc` step with PIQP", whole_us[solved]),
        row("`ttempc` step, QP without active bounds", whole_us[rest], without),
        row("`ttempc` step without its QP", (whole_us - qp_us)[1:], over),
    ]
    for part, values in zip(_PARTS, parts_us.T, strict=True):
        if part == _QP:
            result.append(row("- QP, by PIQP", values[solved]))
            result.append(row("- QP, without active bounds", values[rest]))
        else:
            result.append(row(f"- {part}", values[1:]))
    return result
