"""`ttempc sweep`: drive all runs of a study."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from tqdm import tqdm

from . import options

if TYPE_CHECKING:
    from ..sweep.sweep import Progress

_ABOUT = """\
Drives all runs of a study, as many at a time as there are workers, and writes into DIR:

  results.jsonl   one row a run, as it ends; opens in pandas and polars as it is
  study.toml      the study, resolved      versions.json   what drove it
  logs/           the logs that the study keeps

The same command carries on where a sweep was interrupted, whatever interrupted it. The keys of
a study and the columns of a row are in docs/sweeps.md.

Exit code 0 where every run has its row, however it ended, 2 for bad input (one line; no run is
made), 130 where it was interrupted.
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "sweep", "drive all runs of a study", _ABOUT)
    parser.add_argument("study", metavar="STUDY", help="name of a shipped study or a .toml file")
    add_workers(parser)
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make, or to carry on in (default: runs/sweep-STUDY)",
    )
    parser.add_argument(
        "--dry-run",
        action="store_true",
        help="check the plan, print it, its size and an estimate of time and disk; write nothing",
    )
    parser.set_defaults(command=_sweep)


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add what a command that makes many runs takes: who carries them out."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=_count,
        metavar="N",
        help="processes on this machine (default: one a core; 0: in this process)",
    )
    where.add_argument("--dask", metavar="ADDRESS", help="of a Dask scheduler: tcp://HOST:PORT")


def _count(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"must be a whole number from 0, got {text!r}")
    return int(text)


def _sweep(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and Dask take seconds to load, and help should not wait.
    from ..sweep.cost_estimate import estimate_cost, format_plan
    from ..sweep.engine import engine
    from ..sweep.folder import is_begun, lock_folder
    from ..sweep.inert_axes import find_inert_axes
    from ..sweep.plan import SweepPlan
    from ..sweep.study import load_study
    from ..sweep.sweep import sweep

    name, study = load_study(arguments.study)
    plan = SweepPlan(name, study)
    extent = plan.extent()
    folder = arguments.out or Path("runs") / f"sweep-{name}"
    if arguments.dry_run or not is_begun(folder):
        for axis in find_inert_axes(plan):
            print(f"ttempc: note: axis {axis}: changes nothing, no run reads it", file=sys.stderr)
        for reason in extent.refused:
            print(f"ttempc: note: left out: {reason}", file=sys.stderr)
    if arguments.dry_run:
        print(format_plan(plan, extent, estimate_cost(plan, extent), arguments.workers))
        return 0
    begun = False
    try:
        with (
            engine(arguments.workers, arguments.dask) as carried_out,
            lock_folder(folder, plan) as taken,
        ):
            begun = True
            sweep(plan, taken, carried_out, _Reporter(extent.runs))
    except KeyboardInterrupt:
        if not begun:
            raise
        print(f"ttempc: interrupted; the same command carries on in {folder}", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    print(_told(folder / "results.jsonl"))
    return 0


class _Reporter:
    """Shows how far a sweep is: a bar for people, a line every tenth for files."""

    def __init__(self, runs: int) -> None:
        self._bar = tqdm(
            total=runs, unit="run", disable=not sys.stderr.isatty(), leave=False, smoothing=0.05
        )
        self._every = max(1, runs // 10)

    def __call__(self, progress: Progress) -> None:
        self._bar.update(progress.done - self._bar.n)
        if self._bar.disable and progress.done % self._every == 0:
            print(f"{progress.done} of {progress.runs} runs", file=sys.stderr, flush=True)
        if progress.done == progress.runs:
            self._bar.close()


def _told(results: Path) -> str:
    """Return how the runs of a sweep ended, and where their rows are."""
    from collections import Counter

    from ..sweep.results import rows

    counts = Counter(str(row["status"]) for row in rows(results))
    ended = ", ".join(f"{count} {status}" for status, count in counts.most_common())
    return f"{counts.total()} runs: {ended}\nrows      {results}"
