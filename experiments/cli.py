"""The command line: `ttempc run`, `ttempc card`, `ttempc list`."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

from experiments.errors import ExperimentError
from experiments.scenario import load, shipped
from experiments.table import table
from testbed.errors import TestbedError
from testbed.vehicle_file import read_vehicle, shipped_vehicles
from ttempc.controllers import CONTROLLERS
from ttempc.errors import TtempcError

_EXIT_CHECK_FAILED = 1
_EXIT_BAD_INPUT = 2
_EXIT_INTERRUPTED = 130
_EXIT_LOST = 3

_ABOUT = """\
A tractor with a steerable trailer drives a figure eight over a bumpy, slippery
field in MuJoCo, under the controller of your choice.

  ttempc run                        the default: scenario `grass`, controller `paper`
  ttempc run wet-slope --seed 7     another field, another draw of terrain and noise
  ttempc run my-field.toml          a scenario of your own; `ttempc list` shows the shipped ones
  ttempc run grass --set soil.cone_index_kpa=250 --set path.laps=1
  ttempc card wet-slope             is it my controller or the simulator? inspects the plant
"""

_RUN = """\
Drives one scenario to its end and writes into DIR:

  summary.json   the figures, SI units     log.mcap       everything, for Foxglove or Rerun
  scenario.toml  all settings, resolved    report.html    one page with the figures
  *.png          the figures

Exit code 0 where the run ended as planned, 2 for bad input (one line says what,
where and what is allowed; nothing is written), 3 where the vehicle was lost
(roll-over, jack-knife, left the field, diverged) or the simulation became
invalid; log and summary are written then, too.
"""

_CARD = """\
Inspects the plant of a scenario - its vehicle, wheels, soil, roughness and slope -
in experiments whose outcome is known without the simulation, or published. Prints
a line a check and writes into DIR:

  card.html   one page, to attach to a paper     card.json   the checks, for scripts
  *.png       the figures

Exit code 0 where all checks hold, 1 where one fails, 2 for bad input (one line;
nothing is written). Takes up to a minute.
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(_EXIT_BAD_INPUT, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    options = _parser().parse_args(arguments)
    try:
        return options.command(options)
    except (ExperimentError, TestbedError, TtempcError) as error:
        print(f"ttempc: error: {error}", file=sys.stderr)
        return _EXIT_BAD_INPUT
    except KeyboardInterrupt:
        print("ttempc: interrupted; what was logged so far is in *.mcap.part", file=sys.stderr)
        return _EXIT_INTERRUPTED
    except BrokenPipeError:  # the reader of our output, as in `| head`, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="ttempc", description=_ABOUT, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"ttempc {version('ttempc')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    drive = commands.add_parser(
        "run",
        help="drive one scenario to its end",
        description=_RUN,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_scenario(drive)
    drive.add_argument("--controller", metavar="NAME", help=f"who drives: {', '.join(CONTROLLERS)}")
    drive.add_argument(
        "--seed", type=_seed, default=1, metavar="N", help="draws terrain and noise (default: 1)"
    )
    drive.add_argument(
        "--json", action="store_true", help="print summary.json, and nothing else, to stdout"
    )
    drive.set_defaults(command=_run)

    inspection = commands.add_parser(
        "card",
        help="inspect the plant of one scenario",
        description=_CARD,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _add_scenario(inspection)
    inspection.add_argument(
        "--wheels",
        choices=("soil", "contact"),
        help="wheel model to inspect: the project's own on soil or MuJoCo's contact (default: "
        "the scenario's)",
    )
    inspection.set_defaults(command=_card)

    listing = commands.add_parser("list", help="show the shipped scenarios and the controllers")
    listing.set_defaults(command=_list)
    return parser


def _add_scenario(parser: argparse.ArgumentParser) -> None:
    """Add what `run` and `card` share: the scenario, changes to it, the folder."""
    parser.add_argument(
        "scenario",
        nargs="?",
        default="grass",
        metavar="SCENARIO",
        help="name of a shipped scenario or path of a .toml file (default: grass)",
    )
    parser.add_argument(
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


def _run(options: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from experiments.run import run

    overrides = list(options.overrides)
    if options.controller is not None:
        overrides.append(f'controller.name="{options.controller}"')
    name, scenario = load(options.scenario, overrides)
    folder = options.out or _fresh(
        Path("runs"), f"{name}-{scenario.controller.name}-{options.seed}"
    )
    finished = run(name, scenario, options.seed, folder)
    if options.json:
        print(finished.summary.to_json())
    else:
        print(table(finished.summary))
        if finished.mismatch:
            print(f"Believed wrongly: {', '.join(map(str, finished.mismatch))}")
        print()
        for what, file in finished.files.items():
            print(f"{what:<10}{file}")
    return 0 if finished.summary.status == "completed" else _EXIT_LOST


def _card(options: argparse.Namespace) -> int:
    # Here for the reason given in `_run`.
    from experiments.card import line, summary_line, write_card

    overrides = list(options.overrides)
    if options.wheels is not None:
        overrides.append(f'plant.wheels="{options.wheels}"')
    name, scenario = load(options.scenario, overrides)
    folder = options.out or _fresh(Path("runs"), f"{name}-card-{scenario.plant.wheels}")
    card = write_card(name, scenario, folder, lambda check: print(line(check), flush=True))
    print(f"\n{summary_line(card)}\npage      {folder / 'card.html'}")
    return 0 if card.passed else _EXIT_CHECK_FAILED


def _list(options: argparse.Namespace) -> int:
    print("Scenarios (ttempc run NAME):")
    for name in shipped():
        print(f"  {name:<14} {load(name)[1].description}")
    print("\nVehicles (plant.vehicle.file):")
    for name in shipped_vehicles():
        print(f"  {name:<14} {read_vehicle(name).description}")
    print("\nControllers (--controller NAME):")
    for name, entry in CONTROLLERS.items():
        print(f"  {name:<20} {entry.about}")
    return 0


def _seed(text: str) -> int:
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(
            f"must be a whole number from 0 to 2**32 - 1, got {text!r}"
        )
    return int(text)


def _fresh(parent: Path, stem: str) -> Path:
    """Return a folder that does not exist yet: the stem, or the stem with a number."""
    folder, count = parent / stem, 1
    while folder.exists():
        count += 1
        folder = parent / f"{stem}-{count}"
    return folder


if __name__ == "__main__":
    sys.exit(main())
