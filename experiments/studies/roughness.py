"""Deviation from the nominal state against the learnt ground noise, field by field.

    python -m experiments.studies.roughness [SEEDS]      (default: 3)

Drives laps of `ttempc-tube` in the tube of `grass` on fields from even to furrowed. For each field:
the filter's factors of the ground and wheel noise (means over the laps after start-up), the mean
largest cross-track deviation of both true axle points, and this deviation over the root and the
fourth root of the ground factor. Then the exponents of a power law, and what a law fitted to the
other fields, h^2 = a^2 + b^2 sqrt(ground), predicts of each. docs/tube.md has the table.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.optimize import nnls

from ttempc.estimation.noise import NoiseScale
from ttempc.types import FloatArray

from ...testbed.recording.record import Recorder
from ...testbed.simulation.loop import drive, prepare
from ...testbed.simulation.setup import SimulationSetup, TickContext
from ..results.containment import Containment, containment
from ..results.tracking_errors import START_UP_S
from ..run.assembly import assemble
from ..scenario.scenario import load
from ..seeds import FITTING
from .batch import run_tasks

FIELDS: Final = {
    "pavement": ("pavement",),
    "grass, class C": ("grass", 'terrain.iso_class="C"'),
    "grass": ("grass",),
    "side-slope": ("side-slope",),
    "patchy": ("patchy",),
    "grass, class E": ("grass", 'terrain.iso_class="E"'),
    "wet-grass": ("wet-grass",),
    "wet-slope": ("wet-slope",),
    "grass, class F": ("grass", 'terrain.iso_class="F"'),
    "furrows": ("furrows",),
}
"""Scenario and overrides of each field."""

PATH: Final = "path.laps=1"
_SETTINGS: Final = ('controller.name="ttempc-tube"', 'controller.tube="grass"')


def lap(task: tuple[str, int]) -> FloatArray:
    """Drive a lap on a field with a seed.

    Returns:
        Mean ground and wheel factor, largest cross-track deviations of tractor and trailer [m].
    """
    field, seed = task
    name, *overrides = FIELDS[field]
    _, scenario = load(name, [PATH, *_SETTINGS, *overrides])
    assembly, recorder, factors = assemble(scenario, seed), Recorder(), []

    def observe(setup: SimulationSetup, tick: TickContext) -> None:
        if tick.estimate is not None and tick.estimate.noise_factors is not None:
            factors.append((tick.estimate.time_s, *tick.estimate.noise_factors))

    stages = [stage for stage in assembly.stages if stage is not prepare]
    drive(assembly.setup(recorder), assembly.ticks, (*stages, observe))
    learnt = np.array(factors)
    mean = learnt[learnt[:, 0] >= START_UP_S, 1:].mean(axis=0)
    across = containment(recorder.record()).deviation[:, [*Containment.ACROSS.values()]]
    return np.array([mean[NoiseScale.GROUND], mean[NoiseScale.WHEEL], *np.abs(across).max(axis=0)])


def left_out(ground: FloatArray, width: FloatArray) -> FloatArray:
    """Return width over the prediction of a law fitted to all other fields, (n,).

    The law h^2 = a^2 + b^2 sqrt(ground) is fitted by relative least squares with a^2, b^2 >= 0.
    """
    rows = np.column_stack([np.ones(len(ground)), np.sqrt(ground)])
    ratios = []
    for field in range(len(ground)):
        others = np.arange(len(ground)) != field
        weights, _ = nnls(rows[others] / width[others, None] ** 2, np.ones(others.sum()))
        ratios.append(width[field] / np.sqrt(rows[field] @ weights))
    return np.array(ratios)


def lines(fields: list[str], means: FloatArray) -> Iterator[str]:
    """Yield the lines of the report for the means of each field, (n, 4) as of `lap`."""
    ground, width = means[:, 0], means[:, 2:]
    ratios = np.column_stack([left_out(ground, column) for column in width.T])
    yield (
        "| field | ground | wheel | largest across, tractor / trailer [cm] | over root | "
        "over fourth root | over prediction from the other fields |"
    )
    yield "|---" * 7 + "|"
    for field, row, ratio in zip(fields, means, ratios, strict=True):
        cells = (100.0 * row[2:], 100.0 * row[2:] / row[0] ** 0.5, 100.0 * row[2:] / row[0] ** 0.25)
        texts = [f"{tractor:.1f} / {trailer:.1f}" for tractor, trailer in cells]
        texts.append(f"{ratio[0]:.2f} / {ratio[1]:.2f}")
        yield f"| {field} | {row[0]:.2f} | {row[1]:.2f} | {' | '.join(texts)} |"
    yield ""
    slopes = [np.polyfit(np.log(ground), np.log(column), 1)[0] for column in width.T]
    yield f"Exponent of the ground factor: tractor {slopes[0]:.2f}, trailer {slopes[1]:.2f}"


def main(seeds: int = 3) -> None:
    """Drive the laps and print the report."""
    first = FITTING.stop - seeds
    tasks = [(field, seed) for field in FIELDS for seed in range(first, FITTING.stop)]
    laps = np.array(list(run_tasks(lap, tasks, "roughness")))
    means = laps.reshape(len(FIELDS), seeds, -1).mean(axis=1)
    print("\n".join(lines([*FIELDS], means)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
