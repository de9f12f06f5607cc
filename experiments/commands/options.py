"""Declaration of commands, the options that several of them share, and exit codes."""

from __future__ import annotations

import argparse
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from inspect import cleandoc
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from ...testbed.atomic_write import partial_path
from ...testbed.log import log_path
from ..errors import BadOptions

if TYPE_CHECKING:
    from ..scenario.scenario import Scenario

EXIT_CHECK_FAILED: Final = 1
EXIT_BAD_INPUT: Final = 2
EXIT_LOST: Final = 3  # the run ended early: stopped, roll-over, jack-knife, off the field, stuck
EXIT_INTERRUPTED: Final = 130


@dataclass(frozen=True)
class Option:
    """An option or a positional argument: flags and settings of `argparse`."""

    flags: tuple[str, ...]
    settings: Mapping[str, Any]
    group: str  # options of one group exclude each other; "": of none

    def but(self, **changes: Any) -> Option:  # noqa: ANN401 - of argparse
        """Return the same option with other settings."""
        return replace(self, settings={**self.settings, **changes})


def option(*flags: str, group: str = "", **settings: Any) -> Option:  # noqa: ANN401 - of argparse
    """Return an option from the arguments of `add_argument`."""
    return Option(flags, settings, group)


@dataclass(frozen=True)
class Command:
    """A command: the function that carries it out and returns the exit code, and its options."""

    run: Callable[[argparse.Namespace], int]
    options: tuple[Option, ...]

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Declare description and options of the command."""
        parser.description = cleandoc(self.run.__doc__ or "")
        parser.set_defaults(command=self.run)
        groups: dict[str, Any] = {"": parser}
        for item in self.options:
            if item.group not in groups:
                groups[item.group] = parser.add_mutually_exclusive_group()
            groups[item.group].add_argument(*item.flags, **item.settings)


@dataclass(frozen=True)
class Group:
    """A command with actions of its own, such as `ttempc log info`."""

    about: str
    actions: Mapping[str, Command]

    def add_to(self, parser: argparse.ArgumentParser) -> None:
        """Declare the actions."""
        parser.description = self.about
        below = parser.add_subparsers(required=True, metavar="ACTION")
        for name, action in self.actions.items():
            title = cleandoc(action.run.__doc__ or "").partition("\n")[0]
            shown = argparse.RawDescriptionHelpFormatter
            action.add_to(below.add_parser(name, help=title, formatter_class=shown))


def command(*options: Option) -> Callable[[Callable[[argparse.Namespace], int]], Command]:
    """Declare a function as a command; its docstring is the description."""
    return lambda run: Command(run, options)


def whole_number(low: int, high: int) -> Callable[[str], int]:
    """Return a reader of whole numbers from `low` to `high` for `argparse`."""

    def read(text: str) -> int:
        if not text.isdecimal() or not low <= int(text) <= high:
            wanted = f"must be a whole number from {low} to {high}"
            raise argparse.ArgumentTypeError(f"{wanted}, got {text!r}")
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


def span(text: str | None) -> tuple[float, float]:
    """Return beginning and end [s] of FROM:TO; an empty side, or no text, is without limit.

    Raises:
        BadOptions: a side is no number, or the end is not later.
    """
    begin, colon, end = (text or ":").partition(":")
    try:
        limits = float(begin or "-inf"), float(end or "inf")
    except ValueError:
        limits = math.nan, math.nan
    if not colon or not limits[0] < limits[1]:
        raise BadOptions(f"--seconds: must be FROM:TO in seconds, as 10:60 or 10:, got {text!r}")
    return limits


def positive(text: str) -> float:
    """Read a positive time [s], length [m] or factor, of a size that clocks can count."""
    if not 1e-6 <= (value := number(text)) <= 1e6:
        raise argparse.ArgumentTypeError(f"must be from 1e-6 to 1e6, got {text}")
    return value


def _size(text: str) -> tuple[int, int]:
    """Read WIDTHxHEIGHT."""
    match = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if not match:
        raise argparse.ArgumentTypeError(f"must be WIDTHxHEIGHT, as 1280x720, got {text!r}")
    return int(match[1]), int(match[2])


def out(metavar: str, default: str) -> Option:
    """Return `-o`, the place that a command writes, with its default in words."""
    refusal = "" if "continue" in default else "; an existing one is refused"
    text = f"{'folder' if metavar == 'DIR' else 'file'} to write ({default}){refusal}"
    return option("-o", "--out", type=Path, metavar=metavar, help=text)


def json_of(what: str) -> Option:
    """Return `--json`, for scripts."""
    text = f"print {what} as JSON, and nothing else, to stdout"
    return option("--json", action="store_true", help=text)


SCENARIO: Final = option(
    "scenario",
    nargs="?",
    default="grass",
    metavar="SCENARIO",
    help="name of a shipped scenario or path of a .toml file (default: grass)",
)
LOG: Final = option("log", type=log_path, metavar="LOG", help="log or folder of a run")
SET: Final = option(
    "--set",
    action="append",
    default=[],
    metavar="KEY=VALUE",
    dest="overrides",
    help="override a value of the scenario, e.g. soil.cone_index_kpa=250; may be repeated",
)
TRUST: Final = option(
    "--trust",
    action="store_true",
    help="run the code of controllers, estimators and stages that the file names as "
    "package.module:factory; what you name yourself is run without",
)
CHANGES: Final = SET, TRUST
CONTROLLER: Final = option(
    "--controller",
    metavar="NAME",
    help="controller, see `ttempc list`, or package.module:factory of your own",
)
VEHICLE: Final = option(
    "--vehicle",
    metavar="NAME|FILE",
    help="shipped vehicle, vehicle file, or result of `ttempc fit vehicle`",
)
SEED: Final = option(
    "--seed",
    type=whole_number(0, 2**32 - 1),
    default=1,
    metavar="N",
    help="draws terrain and noise (default: 1)",
)
SPEED: Final = option(
    "--speed", type=positive, metavar="X", help="simulated seconds per second of wall clock or film"
)
LIMIT: Final = option(
    "--limit",
    type=positive,
    metavar="M",
    help="a run also fails above this 95 %% cross-track error of the working point, in m "
    "(default: only runs that end early fail)",
)
WORKERS: Final = option(
    "--workers",
    type=whole_number(0, 1000),
    metavar="N",
    help="processes on this machine (default: one per core; 0: in this process)",
    group="workers",
)
DASK: Final = option(
    "--dask",
    metavar="ADDRESS",
    help="address of a Dask scheduler: tls:// or tcp://HOST:PORT. tcp:// has neither password nor "
    "encryption: everyone who reaches the scheduler runs code here and on the workers",
    group="workers",
)
ENGINE: Final = WORKERS, DASK
QUIET: Final = option("-q", "--quiet", action="store_true", help="print errors only")
FIGURES: Final = (
    option(
        "--format",
        metavar="FORMAT[,FORMAT]",
        help="of the figures: pdf, svg, png",
    ),
    option("--width", metavar="WIDTH", help="single (8.8 cm), double (18.1 cm), or in cm"),
    option("--only", nargs="+", metavar="NAME", help="these figures (default: all)"),
)
"""Formats, width and choice of figures."""

LATEX: Final = option(
    "--latex", action="store_true", help="tables for a paper, in LaTeX with the package booktabs"
)

PICTURE: Final = (
    option(
        "--camera",
        default="chase",
        help="chase (behind, default), top, side, hitch, split (chase and top), or plan, which "
        "needs no OpenGL",
    ),
    option(
        "--size",
        type=_size,
        metavar="WxH",
        help="pixels, both even (default: 1280x720)",
    ),
    option(
        "--ghost",
        action="append",
        default=[],
        metavar="reference|LOG",
        help="draw a translucent vehicle where the reference is, or where that of another run is; "
        "may be repeated",
    ),
    option("--no-display", action="store_true", help="leave out texts, bars and legend"),
    option("--from", type=number, dest="begin_s", metavar="S", help="start [s] (default: of log)"),
    option("--to", type=number, dest="end_s", metavar="S", help="end [s] (default: of the log)"),
    SPEED.but(default=8.0, help="simulated seconds per second of film (default: 8)"),
)
"""Camera, size, span and speed of a picture or film."""


def load_scenario(arguments: argparse.Namespace) -> tuple[str, Scenario]:
    """Return name and settings of the scenario with all changes, the controller among them.

    Raises:
        InvalidScenario: the scenario or a change is invalid, or the file names code that the user
            does not.
    """
    from ..run.user_code import named_parts, refuse_untrusted
    from ..scenario.scenario import read_scenario

    changes = scenario_changes(arguments.overrides, getattr(arguments, "controller", None))
    if getattr(arguments, "vehicle", None):
        changes = _over_vehicle(arguments.vehicle, changes)
    source = read_scenario(arguments.scenario)
    scenario = source.scenario(changes, changed_by="--set")
    if not arguments.trust:
        refuse_untrusted(source.file, named_parts(scenario), changes)
    return source.name, scenario


def _over_vehicle(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    """Return the changes over those of a vehicle: a shipped one, its file, or one that was fitted.

    Raises:
        InvalidScenario: the file is no TOML.
    """
    from ...testbed.configuration.config_io import read_toml
    from ..errors import InvalidScenario
    from ..scenario.scenario import merge_tables

    file = Path(name)
    vehicle = str(file.resolve()) if file.suffix else name
    tables: dict[str, Any] = {"plant": {"vehicle": {"file": vehicle}}}
    content = read_toml(file, InvalidScenario) if file.suffix else {}
    if "fit" in content:  # of `ttempc fit vehicle`: tables of a scenario
        tables = {table: value for table, value in content.items() if table != "fit"}
    merge_tables(tables, changes)
    return tables


def scenario_changes(overrides: list[str], controller: str | None) -> dict[str, Any]:
    """Return the tables that `--set` and `--controller` change.

    Raises:
        InvalidScenario: a change is no KEY=VALUE.
    """
    from ..scenario.scenario import merge_tables, parse_overrides

    changes = parse_overrides(overrides)
    if controller is not None:
        merge_tables(changes, {"controller": {"name": controller}})
    return changes


def refuse_given(arguments: argparse.Namespace, names: tuple[str, ...], reason: str) -> None:
    """Refuse options that have no meaning beside others.

    Raises:
        BadOptions: for the first that is given.
    """
    for name in names:
        if vars(arguments)[name] not in (None, False, []):
            raise BadOptions(f"--{name.replace('_', '-')}: {reason}")


def unused_path(parent: Path, stem: str, suffix: str = "") -> Path:
    """Return the path of a new folder or file: the stem, with a number appended if it exists."""
    path = parent / f"{stem}{suffix}"
    count = 1
    while path.exists() or partial_path(path).exists():
        count += 1
        path = parent / f"{stem}-{count}{suffix}"
    return path
