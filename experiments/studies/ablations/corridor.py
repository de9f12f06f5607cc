"""Corridor of `rows`: laps outside it by controller, and the half widths of `ttempc` over speed.

    python -m experiments.studies.ablations.corridor [SEED ...]
    python -m experiments.studies.ablations.corridor --calibrate [SEED ...]

Default: 200 reported seeds, of which the other controllers drive the first 60; ten tuning seeds.

The table counts the laps in which tractor or trailer point leaves the corridor after the first 8 s,
and those that end early. `ttempc` drives at the speed that its half widths allow, the others at
that of the scenario.

`--calibrate` measures these half widths on tuning seeds and prints the options. The largest
distance of a lap is taken for a sample of a Gumbel distribution, the limit for maxima of many
samples with light tails (Coles 2001, "An introduction to statistical modeling of extreme values",
theorem 3.1). Its location and its scale are linear in the speed in the corridor (section 6.2
there), and so is each quantile. The half width is that which one lap in 2000 exceeds.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from scipy.optimize import minimize
from scipy.stats import gumbel_r

from ttempc.types import FloatArray

from ...results.statistics import proportion
from ...results.summary import Summary
from ...scenario.scenario import load
from ...seeds import TUNING, report_seeds
from ..batch import StudyRun, simulate_runs

SCENARIO: Final = "rows"
LAPS: Final = 200
RIVAL_LAPS: Final = 60  # of each controller that does not plan its speed by its half widths
CONTROLLERS: Final = {
    "`ttempc`": (),
    "`ttempc`, `corridor = false`": ("controller.options.corridor=false",),
    "`pid`": ('controller.name="pid"',),
    "`lqr`": ('controller.name="lqr"',),
    "`nmpc-rti`": ('controller.name="nmpc-rti"',),
}
SPEEDS: Final = (0.4, 0.7, 1.0)  # of the calibration [m/s]
CALIBRATION_LAPS: Final = 10  # at each of them
MISSED: Final = 1 / 2000  # share of the laps beyond the half width
_SCALE: Final = (1e-3, None)  # bounds of a scale, in units of the mean distance


def largest_m(summary: Summary) -> list[float]:
    """Return the largest distances of tractor and trailer point [m], infinite for a lost run."""
    corridor = summary.corridor
    if summary.status != "completed" or corridor is None:
        return [np.inf, np.inf]
    largest = corridor.tractor.max_m, corridor.trailer.max_m
    return [np.inf if distance is None else distance for distance in largest]


def half_width_m() -> float:
    """Return the half width of the corridor [m]."""
    corridor = load(SCENARIO)[1].corridor
    assert corridor is not None
    return corridor.half_width_m


def table(seeds: Sequence[int] = report_seeds(LAPS)) -> Iterator[str]:
    """Yield the lines of the table."""
    yield (
        "| controller | laps outside | share (95 % interval) | tractor: median, largest [cm] "
        "| trailer: median, largest [cm] | time [s] |"
    )
    yield "|---|---|---|---|---|---|"
    for label, overrides in CONTROLLERS.items():
        driven = seeds[:RIVAL_LAPS] if overrides else seeds
        runs = simulate_runs([StudyRun(SCENARIO, seed, overrides) for seed in driven])
        distance = np.array([largest_m(run) for run in runs])  # (laps, 2)
        outside = proportion(int(np.sum(distance.max(axis=1) > half_width_m())), len(runs))
        low, high = (100.0 * end for end in outside.ends)
        points = [
            f"{100.0 * np.median(of_point):.1f}, {100.0 * of_point.max():.1f}"
            for of_point in distance.T
        ]
        yield (
            f"| {label} | {outside.count} of {outside.total} | "
            f"{100.0 * outside.value:.1f} % ({low:.1f} to {high:.1f}) | {points[0]} | {points[1]} "
            f"| {np.median([run.duration_s for run in runs]):.0f} |"
        )


def half_widths(speed_mps: FloatArray, distance_m: FloatArray) -> tuple[float, float]:
    """Return h_0 [m] and h_1 [s] of one point, see `SpeedTube`.

    Args:
        speed_mps: of each lap in the corridor, (n,).
        distance_m: largest distance of the point in it, (n,).
    """
    columns = np.column_stack([np.ones_like(speed_mps), speed_mps])
    unit = float(distance_m.mean())

    def misfit(parameters: FloatArray) -> float:
        location, scale = columns @ parameters[:2], columns @ parameters[2:]
        return -float(gumbel_r.logpdf(distance_m / unit, location, scale).sum())

    fit = minimize(misfit, [0.5, 0.5, 0.1, 0.1], bounds=[(0.0, None), (0.0, None)] + 2 * [_SCALE])
    at_rest, per_speed = unit * (fit.x[:2] + gumbel_r.ppf(1.0 - MISSED) * fit.x[2:])
    return float(at_rest), float(per_speed)


def calibration(seeds: Sequence[int] = TUNING[:CALIBRATION_LAPS]) -> Iterator[str]:
    """Yield the lines of the calibration: distances at each speed, and the options."""
    speeds, distances = np.repeat(SPEEDS, len(seeds)), []
    for speed in SPEEDS:
        # Half widths that fit into the corridor at exactly this speed.
        tube = f"controller.options.corridor_per_speed_s=[{half_width_m() / speed!r}, 0.0]"
        overrides = ("controller.options.corridor_at_rest_m=[0.0, 0.0]", tube)
        runs = simulate_runs([StudyRun(SCENARIO, seed, overrides) for seed in seeds])
        distance = np.array([largest_m(run) for run in runs])
        distances.append(distance)
        for name, of_point in zip(("tractor", "trailer"), 100.0 * distance.T, strict=True):
            yield (
                f"{speed:.1f} m/s, {name}: mean {of_point.mean():.2f}, largest "
                f"{of_point.max():.2f} cm of {len(of_point)} laps"
            )
    points = [half_widths(speeds, of_point) for of_point in np.concatenate(distances).T]
    for key, values in zip(
        ("corridor_at_rest_m", "corridor_per_speed_s"), zip(*points, strict=True), strict=True
    ):
        yield f"{key} = [{', '.join(f'{value:.3f}' for value in values)}]"


def main(seeds: Sequence[int] = report_seeds(LAPS), *, calibrate: bool = False) -> None:
    """Print the table, or the calibration."""
    for line in calibration(seeds) if calibrate else table(seeds):
        print(line, flush=True)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    calibrates = "--calibrate" in arguments
    given = [int(item) for item in arguments if item != "--calibrate"]
    default = TUNING[:CALIBRATION_LAPS] if calibrates else report_seeds(LAPS)
    main(given or default, calibrate=calibrates)
