"""Arguments that the commands for films and pictures share."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..film.shot import CAMERAS, SIZE
from . import options

if TYPE_CHECKING:
    from ..film.composition import FilmSetup


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add camera and size of a picture."""
    parser.add_argument(
        "--camera",
        choices=CAMERAS,
        default="chase",
        help="chase (behind, default), top, side, hitch, split (chase and top), or plan, which "
        "needs no OpenGL",
    )
    parser.add_argument(
        "--size",
        type=_size,
        default=SIZE,
        metavar="WxH",
        help=f"pixels, both even (default: {SIZE[0]}x{SIZE[1]})",
    )


def add_span(parser: argparse.ArgumentParser) -> None:
    """Add time span, speed and number of processes of a film."""
    parser.add_argument(
        "--from",
        type=options.number,
        dest="begin_s",
        metavar="S",
        help="start [s] (default: of the log)",
    )
    parser.add_argument(
        "--to", type=options.number, dest="end_s", metavar="S", help="end [s] (default: of the log)"
    )
    parser.add_argument(
        "--speed",
        type=float,
        default=8.0,
        metavar="X",
        help="simulated time over film time (default: 8)",
    )
    parser.add_argument(
        "--workers",
        type=options.whole_number(1, 64),
        default=2,
        metavar="N",
        help="processes that share the frames (default: 2)",
    )


def _size(text: str) -> tuple[int, int]:
    """Read WIDTHxHEIGHT."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, as 1280x720, got {text!r}")
    return int(match[1]), int(match[2])


def path_beside(log: Path, ending: str) -> Path:
    """Return the default path of a picture or film of a log."""
    return log.with_name(f"{log.name.removesuffix('.mcap')}-{ending}")


def write_with_progress(setup: FilmSetup, file: Path, workers: int) -> None:
    """Write a film, with a progress bar if stderr is a terminal."""
    from tqdm import tqdm

    from ..film.render import write_film

    quiet, count = not sys.stderr.isatty(), len(setup.shot.times)
    with tqdm(total=count, desc=file.name, unit="frame", disable=quiet, leave=False) as bar:
        write_film(setup, file, workers, bar.update)
