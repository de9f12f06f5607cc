"""Makes the tables and figures of README and docs, or checks whether they still hold.

    python -m proving_ground.experiments.papers                  names, pages, seeds, minutes, state
    python -m proving_ground.experiments.papers delay ablation   these; kept rows are taken again
    python -m proving_ground.experiments.papers all
    python -m proving_ground.experiments.papers --check          drive all regression checks again
    python -m proving_ground.experiments.papers errata --seeds 201 --out FOLDER      a rehearsal

Works in a checkout only. Exit code 0 if all is made or holds, 1 if --check finds a table that does
not hold, 2 for bad input, 130 if interrupted: the same command goes on with the next run.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ttempc.errors import TtempcError

from ...testbed.errors import TestbedError
from ..errors import ExperimentError
from ..sweep_report.format import format_numbers
from .checks import read_ledger, source_digest
from .pages import ROOT, pages_of_tables
from .runner import Runner, check, holds, write_tables
from .study import Study, all_studies


def main(words: Sequence[str] | None = None) -> int:
    """Execute the command and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="papers", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    known = all_studies()
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", choices=["all", *known, []], help="study, or all")
    add("--check", action="store_true", help="drive the regression checks, make no table")
    add("--workers", type=int, metavar="N", help="processes (default: one per core; 0: this one)")
    add("--seeds", type=int, nargs="+", default=[], metavar="N", help="of a rehearsal, with --out")
    add("--set", nargs="+", default=[], metavar="KEY=VALUE", help="of a rehearsal, with --out")
    add("-o", "--out", type=Path, default=ROOT, metavar="DIR", help="write pages there")
    add("--rows", type=Path, default=Path("runs") / "papers", metavar="DIR", help="kept rows")
    arguments = parser.parse_args(words)
    if (arguments.seeds or arguments.set) and arguments.out == ROOT:
        parser.error("--seeds and --set: go with --out, so that no committed page rests on them")
    pages = pages_of_tables()
    paged = [study for study in known.values() if study.name in pages]
    names = dict.fromkeys(arguments.names)
    chosen = paged if "all" in names else [known[name] for name in names]
    seeds, overrides = tuple(dict.fromkeys(arguments.seeds)), tuple(arguments.set)
    runner = Runner(arguments.rows, arguments.workers, seeds, overrides)
    try:
        if arguments.check:
            return _check(chosen or paged, runner, arguments.out)
        if not chosen:
            _list([*known.values()], arguments.out)
        for study in write_tables(chosen, runner, arguments.out):
            print(f"{study.name:<20} {arguments.out / pages[study.name]}", flush=True)
    except (ExperimentError, TestbedError, TtempcError) as error:
        print(f"papers: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


def _check(studies: Sequence[Study], runner: Runner, out: Path) -> int:
    states = check(studies, runner, out)
    for study in studies:
        print(f"{study.name:<20}{states[study.name]}")
    stale = [study.name for study in studies if not holds(states[study.name])]
    print(f"to be made anew: {', '.join(stale)}" if stale else "all tables hold")
    return 1 if stale else 0


def _list(studies: Sequence[Study], out: Path) -> None:
    ledger, source, pages = read_ledger(out), source_digest(), pages_of_tables()
    print(f"{'name':<20}{'page':<30}{'seeds':<10}{'min':>4}  state")
    for study in studies:
        page, seeds = pages.get(study.name, "-"), format_numbers(study.all_seeds) or "-"
        making = ledger.get(study.name)
        fresh = "fresh" if making and making.source == source else "code or data changed: --check"
        state = fresh if making else "not made"
        print(f"{study.name:<20}{page:<30}{seeds:<10}{study.minutes:4.0f}  {state}")
    print("Minutes on two cores without those of shipped sweeps; rows of a sweep are shared.")


if __name__ == "__main__":
    sys.exit(main())
