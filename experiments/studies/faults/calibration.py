"""Limits of the detectors of faults, from fault-free drives with tuning seeds.

    python -m experiments.studies.faults.calibration [DRIVES]               (a scenario; default: 6)

Drives every shipped scenario with `ttempc`, each on tuning seeds of its own, and prints, for each
detector, the values of `ttempc/guidance/detection/limits.py`: the largest over all scenarios, at
which all detectors together give at most one false alarm in ten hours.

- Sums: with the residual r of a tick, k the allowance and S the sum of |r| - k over a second, a
  cumulative sum exceeds h in a second with probability exp(-theta h) at most, E exp(theta S) = 1
  (Kingman 1964, "A martingale inequality in the theory of queues", for independent S). Where S was
  never positive, any limit will do; the table then has 0.
- Innovations: the largest squares of the statistic in ten seconds, which is nearly normal, follow a
  Gumbel distribution, fitted by its moments (Coles 2001, ch. 3).
- Repetitions have no tail: the noise of a sensor changes every reading.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import brentq

from ttempc.guidance.detection import (
    MOTION_ALLOWANCE,
    STEERING_ALLOWANCE,
    WHEELS_ALLOWANCE,
    InnovationMonitor,
    MotionMonitor,
    RepetitionMonitor,
    StandstillMonitor,
    SteeringMonitor,
    WheelMonitor,
    detectors,
)
from ttempc.types import FloatArray

from ....testbed.recording.record import Recorder
from ...run.assembly import assemble
from ...run.simulate import drive_into
from ...scenario.scenario import load, shipped
from ...seeds import TUNING
from ..batch import run_tasks

DRIVES: Final = 6
FALSE_ALARM_S: Final = 36_000.0  # at most one false alarm of all detectors in this time
_ALLOWANCES: Final = {
    SteeringMonitor: STEERING_ALLOWANCE,
    StandstillMonitor: STEERING_ALLOWANCE,
    MotionMonitor: MOTION_ALLOWANCE,
    WheelMonitor: WHEELS_ALLOWANCE,
}
_BLOCK_S: Final = 10.0  # of the maxima
_COUNT: Final = sum(not isinstance(item, RepetitionMonitor) for item in detectors())
_EULER: Final = 0.5772156649015329


@dataclass(frozen=True, slots=True)
class Drive:
    """A drive without faults."""

    scenario: str
    seed: int
    seconds: float = math.inf  # it may end earlier


def residuals(drive: Drive) -> FloatArray:
    """Return the residuals of all detectors at every tick of a drive, (ticks, detectors)."""
    assembly = assemble(load(drive.scenario)[1], drive.seed)
    ticks = round(min(drive.seconds / assembly.guidance.period_s, assembly.ticks))
    rows: list[list[float]] = []

    def observe(k: int) -> None:
        rows.append([item.residual for item in assembly.guidance.detectors])

    drive_into(Recorder(), replace(assembly, ticks=ticks), on_tick=observe, prepared=False)
    return np.array(rows)


def sum_limit(values: FloatArray, allowance: float, per_s: int) -> float:
    """Return the limit h of a cumulative sum of |values| (n,) above an allowance."""
    excess = np.abs(values[np.isfinite(values)]) - allowance
    sums = excess[: len(excess) // per_s * per_s].reshape(-1, per_s).sum(axis=1)
    if sums.max() <= 0.0:
        return 0.0

    def log_mean(theta: float) -> float:
        return float(np.log(np.mean(np.exp(theta * (sums - sums.max()))))) + theta * sums.max()

    theta = float(brentq(log_mean, 1e-6 / sums.max(), 1e3 / sums.max()))  # pyright: ignore[reportArgumentType] - a root alone
    return math.log(FALSE_ALARM_S * _COUNT) / theta


def maximum_limit(values: FloatArray, per_s: int) -> float:
    """Return the level that a statistic (n,) exceeds once in the time of a false alarm."""
    values, block = values[np.isfinite(values)], round(_BLOCK_S * per_s)
    maxima = values[: len(values) // block * block].reshape(-1, block).max(axis=1) ** 2
    scale = float(maxima.std(ddof=1)) * math.sqrt(6.0) / math.pi
    count = FALSE_ALARM_S / _BLOCK_S * _COUNT
    return math.sqrt(float(maxima.mean()) - _EULER * scale + scale * math.log(count))


def main(drives: int = DRIVES) -> None:
    """Drive all shipped scenarios and print the limit of every detector."""
    names = shipped()
    seeds = iter(TUNING)
    tasks = [Drive(name, next(seeds)) for name in names for _ in range(drives)]
    results = list(run_tasks(residuals, tasks, "drives"))
    fields = {
        name: np.concatenate(results[n * drives : (n + 1) * drives]) for n, name in enumerate(names)
    }
    print("| detector | largest residual | limit | on |\n|---|---|---|---|")
    for n, detector in enumerate(detectors()):
        if isinstance(detector, RepetitionMonitor):
            continue
        columns = {name: rows[:, n] for name, rows in fields.items()}
        if isinstance(detector, InnovationMonitor):
            limits = {name: maximum_limit(column, 5) for name, column in columns.items()}
        else:
            allowance = _ALLOWANCES[type(detector)]
            limits = {name: sum_limit(column, allowance, 5) for name, column in columns.items()}
        worst = max(limits, key=limits.__getitem__)
        largest = max(float(np.nanmax(np.abs(column))) for column in columns.values())
        where = worst if limits[worst] else "-"
        print(f"| {detector.name} | {largest:.4f} | {limits[worst]:.3f} | {where} |")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
