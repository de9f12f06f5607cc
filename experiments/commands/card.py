"""`ttempc card`: validate the plant of one scenario."""

from __future__ import annotations

import argparse
from pathlib import Path

from ...testbed.wheels.wheel_models import WHEEL_MODELS
from . import options

ABOUT = """\
Inspects the plant of a scenario - its vehicle, wheels, soil, roughness and slope -
in experiments whose results are known without the simulation, or published. Prints
one line per check and writes into DIR:

  validation.html   one page, to attach to a paper
  validation.json   the checks, for scripts
  *.png             the figures

Exit code 0 if all checks hold, 1 if one fails, 2 for bad input (one line;
nothing is written). Takes up to a minute.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_scenario(parser)
    parser.add_argument(
        "--wheels",
        choices=tuple(WHEEL_MODELS),
        help="wheel model to inspect: the project's own on soil or MuJoCo's contact (default: "
        "the scenario's)",
    )
    options.add_json(parser, "the checks")
    parser.set_defaults(command=_card)


def _card(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..validation.validation_report import format_check, validation_report

    if arguments.wheels is not None:
        arguments.overrides.append(f'plant.wheels="{arguments.wheels}"')
    name, scenario = options.load_scenario(arguments)
    stem = f"{name}-card-{scenario.plant.wheels}"
    folder = arguments.out or options.unused_path(Path("runs"), stem)
    validation = validation_report(
        name,
        scenario,
        folder,
        on_check=lambda check: None if arguments.json else print(format_check(check), flush=True),
    )
    if arguments.json:
        print(validation.to_json(), end="")
    else:
        print(f"\n{validation.summary_line()}\npage      {folder / 'validation.html'}")
    return 0 if validation.passed else options.EXIT_CHECK_FAILED
