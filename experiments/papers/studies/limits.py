"""Limit of each trial of the benchmark: the oracle, and the regret of `ttempc` against it.

`oracle` freezes the benchmark: it makes the reference values that ship with it, so that the card of
an own controller needs no oracle drive, and the checks of its plant. `regret` puts them beside
`ttempc`, the best of its rivals, and `ttempc` with the true state.
"""

import json
from collections.abc import Mapping
from time import perf_counter
from typing import Final

import numpy as np
import pandas as pd

from ...studies.oracle.drives import DRIVES, oracle
from ...studies.sweep.row import Row, figures
from ...studies.sweep.study import ListAxis, Study
from ...studies.sweep.work import SweepJob
from ...studies.trials.bench import Entrant
from ...studies.trials.definition import VERSION, is_scored, plant_check, scored_part, trial_files
from ...studies.trials.score_card import PUBLIC, ScoreCard, scored_runs
from ..markdown import markdown
from ..runner import Runner
from ..table import Block, Table
from .leaderboard import driven, pair

RIVALS: Final = ("nmpc-rti", "romea-predictive", "romea-backstepping", "lqr", "pid")
"""Controllers without foresight."""

_FOLDER: Final = f"../experiments/studies/trials/{VERSION}"  # from the page
_TRUE_STATE: Final = Entrant("ttempc", {"estimator": "truth"})


def oracle_row(job: SweepJob) -> Row:
    """Drive the oracle of a run and return the row of its best drive."""
    start = perf_counter()
    found = oracle(job.scenario, job.seed, scored_part(job.scenario))
    summary = found.summary
    seconds = perf_counter() - start
    row = job.row(summary.status, summary.failure, figures(summary), seconds)
    tractor = getattr(summary.tracking, scored_part(job.scenario)).tractor.cross_p95_m
    return {
        **row,
        "oracle_m": found.score_m,
        "tractor_m": tractor,
        "first_m": found.scores_m[0],
        "best_drive": 1 + int(np.argmin(found.scores_m)),
    }


def oracle_table(runs: pd.DataFrame) -> Block:
    """Return the oracle of each trial, and the files that freeze the benchmark.

    These are the oracle errors and the results of the plant checks, both of the code that runs.
    """
    lines = []
    reference: dict[str, dict[str, float]] = {}
    for name, own in runs.groupby("scenario"):
        ordered = own.sort_values("seed")
        errors = [round(float(error), 6) for error in ordered["oracle_m"]]
        reference[str(name)] = dict(zip(map(str, ordered["seed"]), errors, strict=True))
        figures_cm = [100.0 * float(own[key].mean()) for key in ("oracle_m", "tractor_m")]
        first = 100.0 * float(own["first_m"].replace(np.inf, np.nan).mean())
        drives = float(own["best_drive"].mean())
        lines.append(
            (f"{name}", *(f"{x:.2f}" for x in figures_cm), f"{first:.1f}", f"{drives:.1f}")
        )
    heads = (
        "trial",
        "oracle: working point [cm]",
        "its tractor [cm]",
        "first drive [cm]",
        f"best of {DRIVES} drives: number",
    )
    plant = {name: plant_check(name) for name in trial_files()}
    files = {f"{_FOLDER}/oracle.json": reference, f"{_FOLDER}/plant.json": plant}
    return Block(
        markdown(heads, lines), files={file: _by_line(table) for file, table in files.items()}
    )


def _by_line(table: Mapping[str, object]) -> bytes:
    """Return a table as JSON, a line for each trial."""
    lines = (f" {json.dumps(name)}: {json.dumps(own)}" for name, own in table.items())
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode()


def _study() -> Study:
    files = [str(file) for name, file in trial_files().items() if is_scored(name)]
    axis = ListAxis(key="scenario", kind="list", values=tuple(files))
    return Study(scenario=files[0], seeds=PUBLIC, axis=(axis,))


def make_regret(runner: Runner) -> str:
    """Return the errors of each trial beside the oracle's."""
    ours = driven(runner, Entrant.of("ttempc", ()), PUBLIC)
    true_state = driven(runner, _TRUE_STATE, PUBLIC)
    rivals = [driven(runner, Entrant.of(name, ()), PUBLIC) for name in RIVALS]
    return regret_table(ours, rivals, true_state)


def regret_table(ours: ScoreCard, rivals: list[ScoreCard], true_state: ScoreCard) -> str:
    """Return a line for each scored trial, working point / tractor, and the regret."""
    lines = []
    for name in scored_runs(ours.trials):
        best = min(rivals, key=lambda card: card.score.trials[name].cost_m.value)
        item = ours.score.trials[name]
        assert item.oracle_m is not None
        lines.append(
            (
                name,
                pair(ours, name),
                f"{pair(best, name)} `{best.controller}`",
                pair(true_state, name),
                f"{100.0 * item.oracle_m:.2f}",
                f"{item.cost_m.value / item.oracle_m:.1f}",
            )
        )
    times = [card.score.times_oracle.value for card in (ours, true_state)]
    rival = min(rivals, key=lambda card: card.score.times_oracle.value)
    lines.append(
        (
            "geometric mean, times the oracle",
            f"{times[0]:.2f}",
            f"{rival.score.times_oracle.value:.2f} `{rival.controller}`",
            f"{times[1]:.2f}",
            "1",
            f"{times[0]:.1f}",
        )
    )
    heads = (
        "p95 of working point / tractor [cm]",
        "`ttempc`",
        "best rival",
        "`ttempc`, true state",
        "oracle",
        "regret",
    )
    return markdown(heads, lines)


TABLES: Final = (
    Table(name="oracle", studies={"oracle": _study()}, work=oracle_row, text=oracle_table),
    Table(name="regret", make=make_regret, seeds=PUBLIC),
)
