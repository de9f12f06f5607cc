"""`ttempc figures`: figures of a run as files for a paper."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from .. import options

ABOUT = """\
Draws the figures of a run from its log as vector graphics with editable text, and
writes the data that each figure shows as CSV.

  ttempc figures runs/grass-ttempc-1/log.mcap
  ttempc figures log.mcap -o figures --format pdf --width single --only error cross-track
  ttempc figures log.mcap --style my-journal.mplstyle --format png --dpi 600
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    # Imported here because only this command needs them, and they load matplotlib.
    from ...figures import FIGURES
    from ...figures.export import FORMATS, WIDTHS_CM, style_of

    parser.add_argument("log", type=Path, metavar="LOG", help="log.mcap of a run")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make (default: beside the log); an existing one is refused",
    )
    parser.add_argument(
        "--format",
        nargs="+",
        choices=FORMATS,
        default=["pdf"],
        dest="formats",
        help="of the files (default: pdf)",
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
        "--only", nargs="+", choices=list(FIGURES), metavar="NAME", help=f"of {', '.join(FIGURES)}"
    )
    parser.set_defaults(command=_figures)


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
    from proving_ground.testbed.log.log_reader import read_log

    from ...figures import FIGURES
    from ...figures.export import export_figures
    from ...output import make_folder, write_file

    folder = arguments.out or arguments.log.with_name(f"{arguments.log.stem}-figures")
    record = read_log(arguments.log)
    make_folder(folder)
    files = export_figures(
        record,
        arguments.formats,
        arguments.width,
        arguments.style,
        arguments.dpi,
        arguments.only or tuple(FIGURES),
    )
    for name, content in files:
        write_file(folder / name, content)
        print(folder / name)
    return 0
