"""`ttempc sweep`: drive all runs of a study."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from ....testbed.terminal import one_line
from .. import options

if TYPE_CHECKING:
    from ...sweep.sweep import Progress

ABOUT = """\
Drives all runs of a study in parallel and writes into DIR:

  results.jsonl   one row per run, written when it ends; opens in pandas and polars
  study.toml      the study, resolved      versions.json   of the software
  logs/           the logs that the study keeps

The same command continues an interrupted sweep. A study that has more seeds or values
of axes than before keeps the rows that it has. The keys of a study and the columns of a row are
in docs/sweeps.md.

Exit code 0 if every run has a row, whatever its status, 2 for bad input (one line; no run is
made), 130 if the sweep was interrupted.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("study", metavar="STUDY", help="name of a shipped study or a .toml file")
    options.add_workers(parser)
    options.add_trust(parser)
    options.add_verbosity(parser, "a line for each run that has ended")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make or to continue (default: runs/sweep-STUDY)",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="check the plan, print it, its size and an estimate of time and disk; write nothing",
    )
    parser.set_defaults(command=_sweep)


def _sweep(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and Dask.
    from ...sweep.cost_estimate import estimate_cost, format_plan
    from ...sweep.engine import engine
    from ...sweep.folder import is_begun, lock_folder
    from ...sweep.inert_axes import find_inert_axes
    from ...sweep.plan import SweepPlan
    from ...sweep.study import load_study
    from ...sweep.sweep import sweep

    name, study = load_study(arguments.study)
    plan = SweepPlan(name, study, trusted=arguments.trust)
    extent = plan.extent()
    folder = arguments.out or Path("runs") / f"sweep-{name}"
    if arguments.dry_run or not (is_begun(folder) or arguments.quiet):
        for axis in find_inert_axes(plan):
            print(f"ttempc: note: axis {axis}: changes nothing, no run reads it", file=sys.stderr)
        for reason in extent.refused:
            print(f"ttempc: note: left out: {reason}", file=sys.stderr)
    if arguments.dry_run:
        print(format_plan(plan, extent, estimate_cost(plan, extent), arguments.workers))
        return 0
    started = False
    try:
        with (
            engine(arguments.workers, arguments.dask) as submit,
            lock_folder(folder, plan) as locked,
        ):
            started = True
            sweep(plan, locked, submit, _Reporter(extent.runs, arguments))
    except KeyboardInterrupt:
        if not started:
            raise
        print(f"ttempc: interrupted; the same command carries on in {folder}", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    if not arguments.quiet:
        print(_summary(folder / "results.jsonl"))
    return 0


class _Reporter:
    """Progress of a sweep: a bar on a terminal, else a line after each tenth of the runs."""

    def __init__(self, runs: int, arguments: argparse.Namespace) -> None:
        from tqdm import tqdm

        self._quiet, self._verbose = arguments.quiet, arguments.verbose
        shown = sys.stderr.isatty() and not self._quiet
        self._bar = tqdm(total=runs, unit="run", disable=not shown, leave=False, smoothing=0.05)
        self._every = max(1, runs // 10)

    def __call__(self, progress: Progress) -> None:
        self._bar.update(progress.done - self._bar.n)
        if self._verbose:
            self._bar.write(_line(progress), file=sys.stderr)
        elif self._bar.disable and not self._quiet and progress.done % self._every == 0:
            print(f"{progress.done} of {progress.runs} runs", file=sys.stderr, flush=True)
        if progress.done == progress.runs:
            self._bar.close()


def _line(progress: Progress) -> str:
    """Return the run that has ended in one line."""
    row = progress.row
    why = f": {row['failure']}" if row["failure"] else ""
    return one_line(
        f"{progress.done} of {progress.runs}: run {row['run']}, {row['scenario']}, "
        f"{row['controller']}, seed {row['seed']}, {row['status']}{why}"
    )


def _summary(results: Path) -> str:
    """Return the counts of the runs by status, and the path of their rows."""
    from ...sweep.results import rows

    counts = Counter(str(row["status"]) for row in rows(results))
    by_status = ", ".join(f"{count} {status}" for status, count in counts.most_common())
    return f"{counts.total()} runs: {by_status}\nrows      {results}"
