"""Makes the tables and figures of README and docs, or checks whether they still hold.

    python -m proving_ground.experiments.papers                  names, pages, seeds
    python -m proving_ground.experiments.papers delay ablation   these; finished runs are kept
    python -m proving_ground.experiments.papers all
    python -m proving_ground.experiments.papers faults --seed 7  with other draws
    python -m proving_ground.experiments.papers --check          drive all regression checks again

Works in a checkout only. Exit code 0 if all is made or holds, 1 if --check finds a table that does
not hold, 2 for bad input, 130 if interrupted: the same command goes on with the next run.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ttempc.errors import TtempcError

from ...testbed.errors import TestbedError
from ..errors import ExperimentError
from ..pictures.sweep_report.format import format_numbers
from .pages import ROOT, pages_of_tables
from .runner import Runner, check, holds, write_tables
from .table import Table, all_tables


def main(words: Sequence[str] | None = None) -> int:
    """Execute the command and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="papers", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = all_tables()
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", choices=["all", *known, []], help="table, or all")
    add("--check", action="store_true", help="drive the regression checks, make no table")
    add("--seed", type=int, metavar="N", help="of tables whose drives are drawn")
    add("--workers", type=int, metavar="N", help="processes (default: one per core; 0: this one)")
    add("-o", "--out", type=Path, default=ROOT, metavar="DIR", help="write pages there")
    add("--rows", type=Path, default=Path("runs") / "papers", metavar="DIR", help="kept rows")
    arguments = parser.parse_args(words)
    pages = pages_of_tables()
    paged = [table for table in known.values() if table.name in pages]
    names = dict.fromkeys(arguments.names)
    chosen = paged if "all" in names else [known[name] for name in names]
    if arguments.seed is not None:
        chosen = [table.anew(arguments.seed) for table in chosen if table.anew]
    runner = Runner(arguments.rows, arguments.workers)
    try:
        if arguments.check:
            return _check(chosen or paged, runner, arguments.out)
        if not chosen:
            _list([*known.values()])
        for table in write_tables(chosen, runner, arguments.out):
            print(f"{table.name:<20} {arguments.out / pages[table.name]}", flush=True)
    except (ExperimentError, TestbedError, TtempcError) as error:
        print(f"papers: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _check(tables: Sequence[Table], runner: Runner, out: Path) -> int:
    states = check(tables, runner, out)
    for table in tables:
        print(f"{table.name:<20}{states[table.name]}")
    stale = [table.name for table in tables if not holds(states[table.name])]
    print(f"to be made anew: {', '.join(stale)}" if stale else "all tables hold")
    return 1 if stale else 0


def _list(tables: Sequence[Table]) -> None:
    pages = pages_of_tables()
    for table in tables:
        seeds = format_numbers(table.all_seeds) or "-"
        print(f"{table.name:<20}{pages.get(table.name, '-'):<30}{seeds}")


if __name__ == "__main__":
    sys.exit(main())
