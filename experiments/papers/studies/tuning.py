"""All controllers tuned by one search with one budget, from their shipped options.

The options that are searched, and their ranges, are the `search_space` of each controller. The cost
of a set is the geometric mean over trials and tuning seeds of the cross-track p95 of the working
point. Shipped and found set are then compared on seeds that the search has not seen.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ttempc.guidance.controllers import CONTROLLERS, controller_options
from ttempc.tuning import SearchRange
from ttempc.types import FloatArray

from ....testbed.randomness import generator
from ....testbed.recording.provenance import code_digest
from ...results.statistics import mean
from ...scenario.scenario import parse_overrides
from ...seeds import report_seeds
from ...studies.search.evolution import evolve
from ...studies.sweep.engine import engine
from ...studies.sweep.row import Row, working_error
from ...studies.sweep.sweep import drive_points
from ..markdown import markdown
from ..runner import Runner
from ..table import Table

TUNED: Final = (
    "ttempc",
    "ttempc-nominal",
    "nmpc-rti",
    "nmpc-decentralised",
    "lqr",
    "pid",
    "romea-backstepping",
    "romea-predictive",
)
"""Controllers that are tuned."""

TRIALS: Final[dict[str, tuple[str, ...]]] = {
    "wet slope": ("wet-slope", "path.radius_m=8", "path.centre_distance_m=22"),
    "10 km/h": ("work-eight", "path.radius_m=20", "path.centre_distance_m=50"),
}
"""Scenario of each trial and its changes; a short lap of each is driven."""

DRIVES: Final = 64
"""Budget of each controller, the drives of its shipped options among them."""
_SEEDS: Final = (71,)  # of tuning
HELD_OUT: Final = report_seeds(5)
_LOSS_M: Final = 0.5  # error of a run that does not complete
_ONE_LAP: Final = {"path.laps": 1}
_SEED: Final = 1  # of the search


@dataclass(frozen=True)
class Tuning:
    """A search for the options of a controller."""

    controller: str
    folder: Path  # of the rows
    drives: int = DRIVES

    @property
    def space(self) -> tuple[SearchRange, ...]:
        """Return the ranges of the options that are searched."""
        return CONTROLLERS[self.controller].search_space

    @property
    def evaluations(self) -> int:
        """Return how many sets of options the budget allows."""
        return self.drives // (len(TRIALS) * len(_SEEDS))

    def start(self) -> FloatArray:
        """Return the positions of the shipped options, (n,)."""
        shipped = controller_options(self.controller, {})
        return np.array([item.position(_entry(shipped, item)) for item in self.space])

    def options(self, point: FloatArray) -> dict[str, object]:
        """Return the options at positions (n,); those that are not searched are left out."""
        shipped = controller_options(self.controller, {})
        found: dict[str, object] = {}
        for item, position in zip(self.space, point.tolist(), strict=True):
            value = item.value(position)
            if item.entry is None:
                found[item.option] = value
                continue
            entries = [*_vector(found.get(item.option, shipped[item.option]))]
            entries[item.entry] = value
            found[item.option] = entries
        return found

    def errors(
        self, options: Mapping[str, object], seeds: tuple[int, ...], label: str
    ) -> FloatArray:
        """Return the logarithms of the errors of all trials under the seeds, (trials, seeds).

        The rows are kept by the `label`: an interrupted search goes on where it was.
        """
        chosen = {"controller": {"name": self.controller, "options": {**options}}}
        found = []
        with engine(0) as here:
            for name, (scenario, *changes) in TRIALS.items():
                (rows,) = drive_points(
                    scenario,
                    [_ONE_LAP],
                    here,
                    settings=parse_overrides(changes) | chosen,
                    seeds=seeds,
                    folder=self.folder / f"{label}-{name.replace(' ', '-')}",
                )
                found.append([math.log(_error(row)) for row in rows])
        return np.array(found)


@dataclass(frozen=True)
class Tuned:
    """Result of a search, and both sets of options on held-out seeds."""

    tuning: Tuning
    shipped: dict[str, object]
    found: dict[str, object]
    before_m: float  # geometric mean on the tuning seeds
    after_m: float
    held_out: FloatArray  # logarithms of the errors of both sets, (2, trials, seeds)


def _vector(value: object) -> list[float]:
    """Return an option that has several numbers as a list."""
    assert isinstance(value, tuple | list)
    return [*value]


def _entry(options: Mapping[str, object], item: SearchRange) -> float:
    """Return the number that a range is about."""
    value = options[item.option]
    number = value if item.entry is None else _vector(value)[item.entry]
    assert isinstance(number, int | float)
    return float(number)


def _error(row: Row) -> float:
    """Return the cross-track p95 of the working point [m]; of a run that is lost, the loss."""
    error = working_error(row)
    return error if error is not None and row["status"] == "completed" else _LOSS_M


def tune(task: Tuning) -> Tuned:
    """Search the options of a controller, then drive shipped and found ones on held-out seeds."""
    numbers = itertools.count(1)

    def cost(point: FloatArray) -> float:
        return float(task.errors(task.options(point), _SEEDS, f"set{next(numbers)}").mean())

    rng = generator(_SEED, "tuning")
    search = evolve(cost, task.start(), task.evaluations, rng)
    shipped = task.options(task.start())
    found = task.options(search.point)
    held_out = [
        task.errors(options, HELD_OUT, f"held-out-{name}")
        for name, options in (("shipped", shipped), ("found", found))
    ]
    return Tuned(
        tuning=task,
        shipped=shipped,
        found=found,
        before_m=math.exp(search.first),
        after_m=math.exp(search.cost),
        held_out=np.array(held_out),
    )


def _line(tuned: Tuned) -> list[str]:
    """Return the line of a controller: options, errors on tuning and on held-out seeds [cm]."""
    changed = []
    for item in tuned.tuning.space:
        before = _entry(tuned.shipped, item)
        after = _entry(tuned.found, item)
        moved = f" -> {after:.3g}" if after != before else ""
        changed.append(f"{item.label} {before:.3g}{moved}")
    shipped, found = 100.0 * np.exp(tuned.held_out.mean(axis=(1, 2)))
    change = tuned.held_out[1] - tuned.held_out[0]
    ratio = mean(change.ravel())
    low, high = (math.exp(end) for end in ratio.ends)
    return [
        f"`{tuned.tuning.controller}`",
        "; ".join(changed),
        f"{100.0 * tuned.before_m:.2f} -> {100.0 * tuned.after_m:.2f}",
        f"{shipped:.2f} -> {found:.2f}",
        f"{math.exp(ratio.value):.3f} ({low:.3f} to {high:.3f})",
    ]


def make(runner: Runner) -> str:
    """Return the options found for all controllers, and what they change."""
    kept = runner.folder / code_digest()
    tasks = [Tuning(name, kept / f"tuning-{name}") for name in TUNED]
    lines = map(_line, runner.map(tune, tasks, "controllers"))
    heads = (
        "controller",
        "options, shipped -> found",
        f"seed {_SEEDS[0]} [cm]",
        "held-out [cm]",
        "found / shipped, held-out: pairs",
    )
    evaluations = tasks[0].evaluations
    text = (
        f"{DRIVES} drives a controller: {evaluations} sets of options on "
        f"{len(TRIALS)} trials ({', '.join(TRIALS)}), geometric mean of the p95 of the working "
        f"point; a run that is lost counts {_LOSS_M:g} m."
    )
    return f"{text}\n\n{markdown(heads, lines)}"


TABLES: Final = (
    Table(
        name="tuning",
        make=make,
        seeds=HELD_OUT,
        checks=(("grass", "romea-backstepping"), ("grass", "romea-predictive")),
    ),
)
