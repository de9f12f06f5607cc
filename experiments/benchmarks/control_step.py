"""Cost of a control step relative to the bare solve of its quadratic programme.

    python -m experiments.benchmarks.control_step [CONTROLLER ...]     (default: paper ttempc)

Replays the estimates of half a lap of the figure eight to a controller: back to back (warm), with a
pause of 20 ms before each step, in which the caches go cold as between control periods (cold), and
the same with the controller's preparation between pause and step (prepared). Each warm step counts
with its fastest of several replays, which reduces the effect of other processes. The bare solve is
the time that PIQP reports for the same steps. It and the ratio leave out steps whose QP needs no
solver.
"""

from __future__ import annotations

import sys
import time
from typing import Final

import numpy as np
from scipy.integrate import solve_ivp

from ttempc.guidance.controllers import make_controller
from ttempc.laws.tracking_controller import TrackingController
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate, FloatArray
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
TICKS = 340  # half a lap at 1 m/s
SEED = 1
NOISE = np.array([0.01, 0.01, 0.005, 0.005, 0.002, 0.002, 0.01])  # of the estimates; m, rad, m/s
REPEATS = 12  # warm replays
COLD_TICKS = 150
PAUSE_S = 0.02

LARGEST_RATIO: Final = 3.0  # of a whole warm step of `ttempc` to its bare solve


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
    controller: TrackingController, estimates: list[Estimate], pause_s: float, prepared: bool
) -> tuple[FloatArray, FloatArray]:
    """Return the times of whole steps and of their bare solves, (N,) [s] each."""
    steps, solves = np.zeros(len(estimates)), np.zeros(len(estimates))
    for k, estimate in enumerate(estimates):
        if pause_s:
            time.sleep(pause_s)
        if prepared:
            controller.prepare(k)
        begin = time.perf_counter()
        result = controller.step(estimate, k)
        steps[k] = time.perf_counter() - begin
        report = result.diagnostics.solver
        solves[k] = (report.solve_time_s if report else 0.0) or np.nan
    return steps, solves


def main(names: list[str]) -> None:
    """Print medians, tails and ratios; exit code 1 if `ttempc` exceeds its largest ratio."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
    print(
        f"{'us':24s}{'step: median':>14s}{'p99':>8s}{'solve: median':>16s}{'p99':>8s}  step/solve"
    )
    too_slow = False
    for name in names:
        estimates = estimates_along(name, vehicle, reference)
        for kind, repeats, ticks, pause_s in (
            ("warm", REPEATS, TICKS, 0.0),
            ("cold", 1, COLD_TICKS, PAUSE_S),
            ("prepared", 1, COLD_TICKS, PAUSE_S),
        ):
            runs = [
                timed(
                    make_controller(name, vehicle, reference, PERIOD_S),
                    estimates[:ticks],
                    pause_s,
                    kind == "prepared",
                )
                for _ in range(repeats)
            ]
            steps, solves = (np.min(times, axis=0) for times in zip(*runs, strict=True))
            middle, tail = 1e6 * np.quantile(steps[1:], (0.5, 0.99))
            solved = np.isfinite(solves[1:])  # the rest has no active bound and needs no solver
            if not solved.any():
                print(
                    f"{name + ', ' + kind:24s}{middle:14.1f}{tail:8.1f}   no QP with active bounds"
                )
                continue
            solve, solve_tail = 1e6 * np.quantile(solves[1:][solved], (0.5, 0.99))
            ratio = float(np.median(steps[1:][solved] / solves[1:][solved]))
            print(
                f"{name + ', ' + kind:24s}{middle:14.1f}{tail:8.1f}{solve:16.1f}{solve_tail:8.1f}"
                f"{ratio:12.2f}"
            )
            too_slow |= name == "ttempc" and kind == "warm" and ratio > LARGEST_RATIO
    if too_slow:
        raise SystemExit(1)


if __name__ == "__main__":
    main(sys.argv[1:] or ["paper", "ttempc"])
