"""`ttempc figures`: figures of a run or of a sweep as files for a paper."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import BadOptions
from .. import options
from ..figure_options import add_figure_files, chosen_figures, write_figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ABOUT = """\
Draws the figures of a run from its log, or those of a sweep from its rows, as vector
graphics with editable text, and writes the data that each figure shows as CSV.

  ttempc figures runs/grass-ttempc-1/log.mcap
  ttempc figures log.mcap -o figures --format pdf --width single --only error cross-track
  ttempc figures runs/sweep-terrain-slip --against pid --format svg
  ttempc figures log.mcap --style my-journal.mplstyle --format png --dpi 600
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    # Imported here because only this command needs it, and it loads matplotlib.
    from ...figures import FIGURES

    parser.add_argument(
        "source",
        type=options.log_path,
        metavar="LOG|DIR",
        help="log or folder of a run, or of a sweep",
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make (default: LOG-figures, or in the sweep's); an existing one is refused",
    )
    names = f"of a run: {', '.join(FIGURES)}; of a sweep: as its files are called"
    add_figure_files(parser, default="pdf", names=names)
    parser.add_argument(
        "--against",
        metavar="NAME",
        help="of a sweep: controller that the others are compared with, as in `ttempc report`",
    )
    parser.set_defaults(command=_figures)


def _figures(arguments: argparse.Namespace) -> int:
    from ...output import make_folder

    source: Path = arguments.source
    default = source.with_name(f"{source.stem}-figures")
    folder = arguments.out or (source / "figures" if source.is_dir() else default)
    figures = chosen_figures(arguments, _drawn(arguments), str(source))
    make_folder(folder)
    write_figures(arguments, figures, folder)
    return 0


def _drawn(arguments: argparse.Namespace) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw the figures of the log or of the sweep."""
    if arguments.source.is_dir():
        from ...results.run_comparison import STATISTICS_FILE
        from ...sweep_report.report import make_report, panel_figures
        from ...sweep_report.runs import read_sweep

        if (arguments.source / STATISTICS_FILE).is_file():
            raise BadOptions(
                f"{arguments.source}: is a comparison and has no logs; for its figures as files: "
                "ttempc compare LOG LOG --format pdf,svg --width single"
            )
        return panel_figures(make_report(read_sweep(arguments.source), arguments.against))
    from ....testbed.log.log_reader import read_log
    from ...figures.export import run_figures

    if arguments.against is not None:
        raise BadOptions("--against: goes with the folder of a sweep, not with a log")
    return run_figures(read_log(arguments.source))
