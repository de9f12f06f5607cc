"""Exit codes and arguments that several commands share."""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ...testbed.atomic_write import partial_path
from ...testbed.log.reader import log_path

if TYPE_CHECKING:
    from ..film.composition import FilmSetup
    from ..film.replay import Replay
    from ..film.shot import Look
    from ..scenario.scenario import Scenario

_REFERENCE: Final = "reference"  # of --ghost

EXIT_CHECK_FAILED: Final = 1
EXIT_BAD_INPUT: Final = 2
EXIT_LOST: Final = 3  # the run ended early: stopped, roll-over, jack-knife, off the field, stuck
EXIT_INTERRUPTED: Final = 130


def add_scenario(parser: argparse.ArgumentParser, writes: bool = True) -> None:
    """Add the scenario, its changes, and the output folder if the command writes one."""
    parser.add_argument(
        "scenario",
        nargs="?",
        default="grass",
        metavar="SCENARIO",
        help="name of a shipped scenario or path of a .toml file (default: grass)",
    )
    if writes:
        parser.add_argument(
            "-o",
            "--out",
            type=Path,
            metavar="DIR",
            help="folder to make (default: a new one in runs/); an existing one is refused",
        )
    add_overrides(parser)
    add_trust(parser)


def add_trust(parser: argparse.ArgumentParser) -> None:
    """Add the permission to run code that a file names."""
    parser.add_argument(
        "--trust",
        action="store_true",
        help="run the code of controllers, estimators and stages that the file names as "
        "package.module:factory; what you name yourself is run without",
    )


def add_overrides(parser: argparse.ArgumentParser) -> None:
    """Add the changes of a scenario."""
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="override a value of the scenario, e.g. soil.cone_index_kpa=250; may be repeated",
    )


def add_json(parser: argparse.ArgumentParser, what: str) -> None:
    """Add the choice to print `what` as JSON, for scripts."""
    parser.add_argument(
        "--json", action="store_true", help=f"print {what} as JSON, and nothing else, to stdout"
    )


def add_verbosity(parser: argparse.ArgumentParser, more: str) -> None:
    """Add the choice to print less, or `more`."""
    level = parser.add_mutually_exclusive_group()
    level.add_argument("-q", "--quiet", action="store_true", help="print errors only")
    level.add_argument("-v", "--verbose", action="store_true", help=f"also print {more}")


def add_controller_and_seed(parser: argparse.ArgumentParser) -> None:
    """Add the controller and the seed of a run."""
    # Imported here because only some commands need it, and it loads SciPy and Numba.
    from ttempc.guidance.controllers import CONTROLLERS

    parser.add_argument(
        "--controller",
        metavar="NAME",
        help=f"controller: {', '.join(CONTROLLERS)}, or package.module:factory of your own",
    )
    add_seed(parser)


def add_seed(parser: argparse.ArgumentParser) -> None:
    """Add the seed of a run."""
    parser.add_argument(
        "--seed",
        type=whole_number(0, 2**32 - 1),
        default=1,
        metavar="N",
        help="draws terrain and noise (default: 1)",
    )


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add the workers of a command that makes many runs."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=whole_number(0),
        metavar="N",
        help="processes on this machine (default: one per core; 0: in this process)",
    )
    where.add_argument(
        "--dask",
        metavar="ADDRESS",
        help="address of a Dask scheduler: tls:// or tcp://HOST:PORT. tcp:// has neither password "
        "nor encryption: everyone who reaches the scheduler runs code here and on the workers",
    )


def load_scenario(arguments: argparse.Namespace) -> tuple[str, Scenario]:
    """Return name and settings of the scenario with all changes, the controller among them.

    Raises:
        InvalidScenario: the scenario or a change is invalid, or the file names code that the user
            does not.
    """
    from ..run.user_code import named_parts, refuse_untrusted
    from ..scenario.scenario import merge_tables, parse_overrides, read_scenario

    changes = parse_overrides(arguments.overrides)
    if getattr(arguments, "controller", None) is not None:
        merge_tables(changes, {"controller": {"name": arguments.controller}})
    source = read_scenario(arguments.scenario)
    scenario = source.scenario(changes, changed_by="--set")
    if not arguments.trust:
        refuse_untrusted(source.file, named_parts(scenario), changes)
    return source.name, scenario


def whole_number(low: int, high: int | None = None) -> Callable[[str], int]:
    """Return a reader of whole numbers from `low` to `high` for `argparse`."""
    allowed = f"from {low}" if high is None else f"from {low} to {high}"

    def read(text: str) -> int:
        if not text.isdecimal() or int(text) < low or (high is not None and int(text) > high):
            raise argparse.ArgumentTypeError(f"must be a whole number {allowed}, got {text!r}")
        return int(text)

    return read


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a finite number, got {text!r}")
    return value


def unused_path(parent: Path, stem: str, suffix: str = "") -> Path:
    """Return the path of a new folder or file: the stem, with a number appended if it exists."""
    path, count = parent / f"{stem}{suffix}", 1
    while path.exists() or partial_path(path).exists():
        count += 1
        path = parent / f"{stem}-{count}{suffix}"
    return path


def add_camera(parser: argparse.ArgumentParser) -> None:
    """Add camera and size of a picture."""
    # Imported here because only the commands for pictures need it.
    from ..film.shot import CAMERAS, QUALITIES, SIZES

    sizes = (f"{quality} {width}x{height}" for quality, (width, height) in SIZES.items())

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
        metavar="WxH",
        help="pixels, both even (default: " + ", ".join(sizes) + ")",
    )
    parser.add_argument(
        "--quality",
        choices=QUALITIES,
        default="draft",
        help="draft (default), or high: finer shadows and edges, less compression",
    )
    parser.add_argument(
        "--exaggerate",
        type=number,
        default=1.0,
        metavar="X",
        help="factor of the cross-track error of driven paths, told in the legend (default: 1)",
    )
    parser.add_argument(
        "--ghost",
        action="append",
        default=[],
        metavar="reference|LOG",
        help="draw a translucent vehicle where the reference is, or where that of another run is; "
        "may be repeated",
    )


def add_span(parser: argparse.ArgumentParser) -> None:
    """Add time span, speed and number of processes of a film."""
    parser.add_argument(
        "--from",
        type=number,
        dest="begin_s",
        metavar="S",
        help="start [s] (default: of the log)",
    )
    parser.add_argument(
        "--to", type=number, dest="end_s", metavar="S", help="end [s] (default: of the log)"
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
        type=whole_number(1, 64),
        default=2,
        metavar="N",
        help="processes that share the frames (default: 2)",
    )


def picture_look(arguments: argparse.Namespace) -> Look:
    """Return the look that the arguments of `add_camera` ask for."""
    from ..film.shot import Look

    return Look(arguments.quality, arguments.exaggerate, _REFERENCE in arguments.ghost)


def picture_size(arguments: argparse.Namespace) -> tuple[int, int]:
    """Return width and height [pixels]: as given, else those of the quality."""
    from ..film.shot import SIZES

    return arguments.size or SIZES[arguments.quality]


def read_ghosts(arguments: argparse.Namespace) -> tuple[Replay, ...]:
    """Return the runs that are drawn as ghosts."""
    from ..film.replay import read_replay

    return tuple(map(read_replay, ghost_logs(arguments)))


def ghost_logs(arguments: argparse.Namespace) -> list[Path]:
    """Return the logs of the runs that are drawn as ghosts."""
    return [log_path(log) for log in arguments.ghost if log != _REFERENCE]


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
