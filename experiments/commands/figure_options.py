"""Arguments of the commands that write figures as files for a paper."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import BadOptions
from . import options

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def add_figure_files(parser: argparse.ArgumentParser, default: str, names: str) -> None:
    """Add formats, width, style and resolution of the figures, and the choice of some.

    Args:
        parser: of the command.
        default: format of the files if the user gives none.
        names: of the figures, for the help of `--only`.
    """
    # Imported here because only these commands need it, and it loads matplotlib.
    from ..figures.export import FORMATS, WIDTHS_CM, style_of

    parser.add_argument(
        "--format",
        type=_formats(FORMATS),
        default=(default,),
        dest="formats",
        metavar="FORMAT[,FORMAT]",
        help=f"of the files: {', '.join(FORMATS)} (default: {default})",
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
    parser.add_argument("--only", nargs="+", metavar="NAME", help=names)


def chosen_figures(
    arguments: argparse.Namespace, figures: Mapping[str, Callable[[], Figure]], source: str
) -> dict[str, Callable[[], Figure]]:
    """Return the figures that `--only` names, or all.

    Raises:
        BadOptions: there is no figure of that name; the message lists those of `source`.
    """
    if unknown := [name for name in arguments.only or () if name not in figures]:
        raise BadOptions(f"--only {unknown[0]}: {source} has {', '.join(figures)}")
    return {name: figures[name] for name in arguments.only or figures}


def write_figures(
    arguments: argparse.Namespace, figures: Mapping[str, Callable[[], Figure]], folder: Path
) -> None:
    """Write the figures and their data into a folder and print the paths."""
    from ..figures.export import export_figures
    from ..output import write_file

    for name, content in export_figures(
        figures, arguments.formats, arguments.width, arguments.style, arguments.dpi
    ):
        write_file(folder / name, content)
        print(folder / name)


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
