"""Arguments of the commands that make pictures of logs."""

from __future__ import annotations

import argparse
import re
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ..film.shot import CAMERAS, SIZE
from . import options

if TYPE_CHECKING:
    from ..film.scenes import Setup

CAMERA_HELP = (
    "chase (behind, default), top, side, hitch, split (chase and top), or plan, which is drawn "
    "without OpenGL"
)


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add camera and size of a picture."""
    parser.add_argument("--camera", choices=CAMERAS, default="chase", help=CAMERA_HELP)
    parser.add_argument(
        "--size",
        type=size,
        default=SIZE,
        metavar="WxH",
        help=f"pixels, both even (default: {SIZE[0]}x{SIZE[1]})",
    )


def add_span(parser: argparse.ArgumentParser) -> None:
    """Add which part of a run is filmed, and how fast."""
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
        help="seconds of the run in a second of film (default: 8)",
    )
    parser.add_argument(
        "--workers",
        type=workers,
        default=2,
        metavar="N",
        help="processes that share the frames (default: 2)",
    )


def size(text: str) -> tuple[int, int]:
    """Read WIDTHxHEIGHT."""
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if not found:
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, as 1280x720, got {text!r}")
    return int(found[1]), int(found[2])


def workers(text: str) -> int:
    """Read a number of processes."""
    if not text.isdecimal() or not 1 <= int(text) <= 64:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1 to 64, got {text!r}")
    return int(text)


def beside(log: Path, ending: str) -> Path:
    """Return the name of a picture beside its log."""
    return log.with_name(f"{log.name.removesuffix('.mcap')}-{ending}")


def shoot(setup: Setup, file: Path, workers: int) -> None:
    """Write a film, with a bar where someone watches."""
    from tqdm import tqdm

    from ..film.film import film

    quiet, count = not sys.stderr.isatty(), len(setup.shot.times)
    with tqdm(total=count, desc=file.name, unit="frame", disable=quiet, leave=False) as bar:
        film(setup, file, workers, bar.update)
