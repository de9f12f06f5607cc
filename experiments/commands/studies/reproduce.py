"""`ttempc reproduce`: make the tables of the documentation, or check them."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import BadOptions
from .. import options

if TYPE_CHECKING:
    from ...reproduce.driver import Driver
    from ...reproduce.entry import Entry

ABOUT = """\
Makes the tables and figures of README and docs and writes them between the markers
of their pages. Without a name it lists them. Works in a checkout only.

  ttempc reproduce                  names, pages, seeds, minutes, what is known of each
  ttempc reproduce delay studies    these; rows that are there already are taken again
  ttempc reproduce all
  ttempc reproduce --check          drive the probes of all tables again: which still hold?
  ttempc reproduce errata --seeds 201 --out /tmp/rehearsal

A probe is a short run of a scenario and a controller behind a table. The record of
their states lies in docs/fingerprints.json. A probe has the same bits, or is equal to
1e-9 m (another processor), or differs: the table is to be made anew.

Exit code 0 if all is made or holds, 1 if --check finds a table that does not, 2 for
bad input (one line), 130 if interrupted: the same command goes on with the next run.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("names", nargs="*", metavar="NAME", help="of a table, or all")
    parser.add_argument("--check", action="store_true", help="drive the probes again, no table")
    parser.add_argument(
        "--workers",
        type=options.whole_number(0),
        metavar="N",
        help="processes on this machine (default: one per core; 0: in this process)",
    )
    parser.add_argument(
        "--seeds",
        type=options.whole_number(0, 2**32 - 1),
        nargs="+",
        metavar="N",
        help="of all runs, for a rehearsal; goes with --out",
    )
    parser.add_argument(
        "-o", "--out", type=Path, metavar="DIR", help="write pages there, not into the checkout"
    )
    parser.add_argument(
        "--rows",
        type=Path,
        metavar="DIR",
        default=Path("runs") / "reproduce",
        help="folder of the rows (default: runs/reproduce)",
    )
    parser.set_defaults(command=_reproduce)


def _reproduce(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo, matplotlib and Dask.
    from ...reproduce.driver import Driver
    from ...reproduce.listing import ENTRIES
    from ...reproduce.pages import ROOT
    from ...reproduce.reproduce import reproduce, select

    if arguments.seeds and arguments.out is None:
        raise BadOptions("--seeds: goes with --out, so that no page of the checkout rests on them")
    chosen = select(ENTRIES, arguments.names)
    seeds = tuple(dict.fromkeys(arguments.seeds)) if arguments.seeds else None
    driver = Driver(arguments.rows, arguments.workers, seeds)
    out: Path = ROOT if arguments.out is None else arguments.out
    if arguments.check:
        return _check(chosen or ENTRIES, driver, out)
    if not chosen:
        _print_list(ENTRIES, out)
        return 0
    try:
        for entry in reproduce(chosen, driver, out):
            print(f"{entry.name:<20} {out / entry.page}", flush=True)
    except KeyboardInterrupt:
        print("ttempc: interrupted; the same command goes on", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    return 0


def _print_list(entries: Sequence[Entry], out: Path) -> None:
    from ...reproduce.ledger import read_ledger, source_digest
    from ...reproduce.listing import minutes
    from ...reproduce.reproduce import known_state
    from ...sweep_report.format import format_numbers

    ledger, source = read_ledger(out), source_digest()
    print(f"{'name':<20}{'page':<30}{'seeds':<10}{'min':>4}  state")
    for entry in entries:
        seeds = format_numbers(entry.all_seeds()) or "-"
        state = known_state(entry, ledger, source)
        print(f"{entry.name:<20}{entry.page:<30}{seeds:<10}{minutes(entry):4.0f}  {state}")
    print("Minutes on two cores; tables of one sweep share its rows.")


def _check(entries: Sequence[Entry], driver: Driver, out: Path) -> int:
    from ...reproduce.reproduce import check

    verdicts = check(entries, driver, out)
    for item in verdicts:
        probe = f" ({item.probe})" if item.probe else ""
        print(f"{item.entry.name:<20}{item.entry.page:<30}{item.state}{probe}")
    stale = sorted({item.entry.page for item in verdicts if not item.holds})
    print(f"to be made anew: {', '.join(stale)}" if stale else "all pages hold")
    return options.EXIT_CHECK_FAILED if stale else 0
