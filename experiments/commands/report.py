"""`ttempc report`: report the results of a sweep."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import options

ABOUT = """\
Reads the rows of a sweep, which may still be running, and writes into DIR/report,
in place of an earlier report:

  report.html   one page: tables to sort, charts, the worst runs, all runs
  summary.md    a short version        *.png   its pictures

  ttempc report runs/sweep-terrain-slip
  ttempc report runs/sweep-terrain-slip --limit 0.6 --against paper

Exit code 2 for bad input, such as a folder without rows (one line; nothing is written).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("folder", type=Path, metavar="DIR", help="of a sweep")
    parser.add_argument(
        "--against",
        metavar="NAME",
        help="controller that the others are compared with (default: the first of the study)",
    )
    parser.add_argument(
        "--limit",
        type=_limit,
        metavar="M",
        help="a run also fails above this 95 %% cross-track error of the trailer, in m",
    )
    parser.add_argument(
        "--envelope",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="also show the results of `ttempc envelope`; may be repeated",
    )
    parser.set_defaults(command=_report)


def _limit(text: str) -> float:
    limit = options.number(text)
    if limit <= 0.0:
        raise argparse.ArgumentTypeError(f"must be a length above 0 in m, got {text!r}")
    return limit


def _report(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load matplotlib.
    from ..sweep_report.envelope_results import read_envelopes
    from ..sweep_report.files import write_report
    from ..sweep_report.report import make_report
    from ..sweep_report.runs import read_sweep

    runs = read_sweep(arguments.folder, arguments.limit)
    content = make_report(runs, arguments.against, read_envelopes(arguments.envelope))
    file = write_report(content, arguments.folder)
    if runs.missing:
        print(f"in progress: {runs.missing} of {runs.planned} runs are missing")
    print(f"page      {file}\nsummary   {file.with_name('summary.md')}")
    return 0
