"""`ttempc run`: drive one scenario to its end."""

from __future__ import annotations

import argparse
from pathlib import Path

from experiments.commands import options
from experiments.scenario import load
from experiments.table import table
from ttempc.controllers import CONTROLLERS

_ABOUT = """\
Drives one scenario to its end and writes into DIR:

  summary.json   the figures, SI units     log.mcap       everything, for Foxglove or Rerun
  scenario.toml  all settings, resolved    report.html    one page with the figures
  *.png          the figures

Exit code 0 where the run ended as planned, 2 for bad input (one line says what,
where and what is allowed; nothing is written), 3 where the vehicle was lost
(roll-over, jack-knife, left the field, diverged) or the simulation became
invalid; log and summary are written then, too.
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "run", "drive one scenario to its end", _ABOUT)
    options.add_scenario(parser)
    parser.add_argument(
        "--controller",
        metavar="NAME",
        help=f"who drives: {', '.join(CONTROLLERS)}, or package.module:factory of your own",
    )
    parser.add_argument(
        "--seed",
        type=options.seed,
        default=1,
        metavar="N",
        help="draws terrain and noise (default: 1)",
    )
    parser.add_argument(
        "--json", action="store_true", help="print summary.json, and nothing else, to stdout"
    )
    parser.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from experiments.run import run

    overrides = list(arguments.overrides)
    if arguments.controller is not None:
        overrides.append(f'controller.name="{arguments.controller}"')
    name, scenario = load(arguments.scenario, overrides)
    folder = arguments.out or options.fresh(
        Path("runs"), f"{name}-{scenario.controller.name.replace(':', '-')}-{arguments.seed}"
    )
    finished = run(name, scenario, arguments.seed, folder)
    if arguments.json:
        print(finished.summary.to_json())
    else:
        print(table(finished.summary))
        if finished.mismatch:
            print(f"Believed wrongly: {', '.join(map(str, finished.mismatch))}")
        for note in finished.notes:
            print(f"{note[0].upper()}{note[1:]}")
        print()
        for what, file in finished.files.items():
            print(f"{what:<10}{file}")
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST
