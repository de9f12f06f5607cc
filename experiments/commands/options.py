"""Arguments that several commands take, and the exit codes of all."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Final

from ttempc.guidance.controllers import CONTROLLERS

from ..output import part_of
from ..scenario.scenario import Scenario, load

EXIT_CHECK_FAILED: Final = 1
EXIT_BAD_INPUT: Final = 2
EXIT_LOST: Final = 3
EXIT_INTERRUPTED: Final = 130

Commands = argparse._SubParsersAction  # the type has no public name


def command(commands: Commands, name: str, help: str, about: str) -> argparse.ArgumentParser:
    """Declare a command with a one-line help and a description that keeps its line breaks."""
    return commands.add_parser(
        name,
        help=help,
        description=about,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )


def add_scenario(parser: argparse.ArgumentParser, writes: bool = True) -> None:
    """Add what a command on one scenario takes: its name, changes to it, the folder it writes."""
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
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        dest="overrides",
        help="lay a value over the scenario, e.g. soil.cone_index_kpa=250; may be repeated",
    )


def add_driver(parser: argparse.ArgumentParser) -> None:
    """Add who drives, and with which seed."""
    parser.add_argument(
        "--controller",
        metavar="NAME",
        help=f"who drives: {', '.join(CONTROLLERS)}, or package.module:factory of your own",
    )
    parser.add_argument(
        "--seed", type=seed, default=1, metavar="N", help="draws terrain and noise (default: 1)"
    )


def driven(arguments: argparse.Namespace) -> tuple[str, Scenario]:
    """Return name and settings of the scenario with its changes, the driver's among them.

    Raises:
        InvalidScenario: it is not understood.
    """
    overrides = list(arguments.overrides)
    if arguments.controller is not None:
        overrides.append(f'controller.name="{arguments.controller}"')
    return load(arguments.scenario, overrides)


def seed(text: str) -> int:
    """Read a seed from the command line."""
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(
            f"must be a whole number from 0 to 2**32 - 1, got {text!r}"
        )
    return int(text)


def number(text: str) -> float:
    """Read a number from the command line."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"must be a finite number, got {text!r}")
    return value


def fresh(parent: Path, stem: str, suffix: str = "") -> Path:
    """Return a folder or file that does not exist yet: the stem, or the stem with a number."""
    path, count = parent / f"{stem}{suffix}", 1
    while path.exists() or part_of(path).exists():
        count += 1
        path = parent / f"{stem}-{count}{suffix}"
    return path
