"""`ttempc report`: page of a sweep from its rows, or of a run from its log."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..errors import BadOptions
from . import options

ABOUT = """\
Of a sweep, which may still be running, it reads the rows and writes into DIR/report,
in place of an earlier report:

  report.html   one page: tables to sort, charts, the worst runs, all runs
  summary.md    a short version        *.png   its pictures

Of a log, also an old, a recovered or a torn one, it writes the page that `ttempc run`
makes, with the numbers that the log has.

  ttempc report runs/sweep-terrain-slip
  ttempc report runs/sweep-terrain-slip --limit 0.6 --against paper
  ttempc report runs/grass-ttempc-1/log.mcap -o page.html

Exit code 2 for bad input, such as a folder without rows (one line; nothing is written).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "source",
        type=options.log_path,
        metavar="DIR|LOG",
        help="folder of a sweep or a run, or its log",
    )
    sweep = parser.add_argument_group("of a sweep")
    sweep.add_argument(
        "--against",
        metavar="NAME",
        help="controller that the others are compared with (default: the best)",
    )
    sweep.add_argument(
        "--limit",
        type=_limit,
        metavar="M",
        help="a run also fails above this 95 %% cross-track error of the working point, in m",
    )
    parser.add_argument_group("of a log").add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="page to write (default: LOG-report.html beside it); an existing one is refused",
    )
    parser.set_defaults(command=_report)


def _limit(text: str) -> float:
    limit = options.number(text)
    if limit <= 0.0:
        raise argparse.ArgumentTypeError(f"must be a length above 0 in m, got {text!r}")
    return limit


def _report(arguments: argparse.Namespace) -> int:
    return _of_log(arguments) if arguments.source.is_file() else _of_sweep(arguments)


def _of_sweep(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load matplotlib.
    from ..sweep_report.report import make_report, write_report
    from ..sweep_report.runs import read_sweep

    folder = arguments.source
    if arguments.out is not None:
        raise BadOptions("--out: goes with a log; the report of a sweep lies in its folder")
    runs = read_sweep(folder, arguments.limit)
    content = make_report(runs, arguments.against)
    file = write_report(content, folder)
    if runs.missing:
        print(f"in progress: {runs.missing} of {runs.planned} runs are missing")
    print(f"page      {file}\nsummary   {file.with_name('summary.md')}")
    return 0


def _of_log(arguments: argparse.Namespace) -> int:
    from ..logs.log_report import report_of_log
    from ..output import refuse_existing, write_file

    given = ("against", "limit")
    if alone := [name for name in given if getattr(arguments, name)]:
        raise BadOptions(f"--{alone[0]}: goes with the folder of a sweep, not with a log")
    file = arguments.out or options.path_beside(arguments.source, "report.html")
    refuse_existing(file)
    write_file(file, report_of_log(arguments.source))
    print(f"page      {file}")
    return 0
