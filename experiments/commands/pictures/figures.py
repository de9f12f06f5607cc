"""`ttempc figures`: figures of a run or of a sweep as files for a paper."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import BadOptions
from .. import options

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
    # Imported here because only this command needs them, and they load matplotlib.
    from ...figures import FIGURES
    from ...figures.export import FORMATS, WIDTHS_CM, style_of

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
    parser.add_argument(
        "--format",
        type=_formats(FORMATS),
        default=("pdf",),
        dest="formats",
        metavar="FORMAT[,FORMAT]",
        help=f"of the files: {', '.join(FORMATS)} (default: pdf)",
    )
    parser.add_argument(
        "--width",
        type=_width(WIDTHS_CM),
        metavar="WIDTH",
        help=f"{', '.join(f'{name} ({cm} cm)' for name, cm in WIDTHS_CM.items())}, or in cm",
    )
    parser.add_argument(
        "--style", type=_style(style_of), metavar="STYLE", help="matplotlib style, name or file"
    )
    parser.add_argument(
        "--dpi", type=_between(30.0, 2400.0), default=300.0, help="of PNG (default: 300)"
    )
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        help=f"of a run: {', '.join(FIGURES)}; of a sweep: as its files are called",
    )
    parser.add_argument(
        "--against",
        metavar="NAME",
        help="of a sweep: controller that the others are compared with, as in `ttempc report`",
    )
    parser.set_defaults(command=_figures)


def _formats(known: Sequence[str]) -> Any:  # noqa: ANN401 - a reader for argparse
    def read(text: str) -> tuple[str, ...]:
        formats = tuple(text.split(","))
        if unknown := [name for name in formats if name not in known]:
            raise argparse.ArgumentTypeError(
                f"got {unknown[0]!r}, must be {', '.join(known)}, separated by commas"
            )
        return formats

    return read


def _width(named: dict[str, float]) -> Any:  # noqa: ANN401 - a reader for argparse
    read = _between(4.0, 100.0)
    return lambda text: named[text] if text in named else read(text)


def _style(style_of: Any) -> Any:  # noqa: ANN401 - a reader for argparse
    def read(text: str) -> str:
        try:
            return style_of(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from None

    return read


def _between(low: float, high: float) -> Any:  # noqa: ANN401 - a reader for argparse
    def read(text: str) -> float:
        value = options.number(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"got {text}, must be from {low:g} to {high:g}")
        return value

    return read


def _figures(arguments: argparse.Namespace) -> int:
    from ...figures.export import export_figures
    from ...output import make_folder, write_file

    source: Path = arguments.source
    default = source.with_name(f"{source.stem}-figures")
    folder = arguments.out or (source / "figures" if source.is_dir() else default)
    figures = _drawn(arguments)
    if unknown := [name for name in arguments.only or () if name not in figures]:
        raise BadOptions(f"--only {unknown[0]}: {source} has {', '.join(figures)}")
    chosen = {name: figures[name] for name in arguments.only or figures}
    make_folder(folder)
    for name, content in export_figures(
        chosen, arguments.formats, arguments.width, arguments.style, arguments.dpi
    ):
        write_file(folder / name, content)
        print(folder / name)
    return 0


def _drawn(arguments: argparse.Namespace) -> dict[str, Callable[[], Figure]]:
    """Return the functions that draw the figures of the log or of the sweep."""
    if arguments.source.is_dir():
        from ...sweep_report.files import panel_figures
        from ...sweep_report.report import make_report
        from ...sweep_report.runs import read_sweep

        return panel_figures(make_report(read_sweep(arguments.source), arguments.against))
    from proving_ground.testbed.log.log_reader import read_log

    from ...figures.export import run_figures

    if arguments.against is not None:
        raise BadOptions("--against: goes with the folder of a sweep, not with a log")
    return run_figures(read_log(arguments.source))
