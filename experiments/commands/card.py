"""`ttempc card`: inspect the plant of one scenario."""

from __future__ import annotations

import argparse
from pathlib import Path

from proving_ground.testbed.wheels.wheel_models import WHEEL_MODELS

from ..scenario.scenario import load
from . import options

_ABOUT = """\
Inspects the plant of a scenario - its vehicle, wheels, soil, roughness and slope -
in experiments whose outcome is known without the simulation, or published. Prints
a line a check and writes into DIR:

  card.html   one page, to attach to a paper     card.json   the checks, for scripts
  *.png       the figures

Exit code 0 where all checks hold, 1 where one fails, 2 for bad input (one line;
nothing is written). Takes up to a minute.
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "card", "inspect the plant of one scenario", _ABOUT)
    options.add_scenario(parser)
    parser.add_argument(
        "--wheels",
        choices=tuple(WHEEL_MODELS),
        help="wheel model to inspect: the project's own on soil or MuJoCo's contact (default: "
        "the scenario's)",
    )
    parser.set_defaults(command=_card)


def _card(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from ..validation.plant_validation import line, summary_line, write_card

    overrides = list(arguments.overrides)
    if arguments.wheels is not None:
        overrides.append(f'plant.wheels="{arguments.wheels}"')
    name, scenario = load(arguments.scenario, overrides)
    folder = arguments.out or options.fresh(Path("runs"), f"{name}-card-{scenario.plant.wheels}")
    card = write_card(name, scenario, folder, lambda check: print(line(check), flush=True))
    print(f"\n{summary_line(card)}\npage      {folder / 'card.html'}")
    return 0 if card.passed else options.EXIT_CHECK_FAILED
