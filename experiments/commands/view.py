"""`ttempc view`: watch a run in MuJoCo's own viewer."""

from __future__ import annotations

import argparse

from experiments.commands import options
from experiments.scenario import load
from ttempc.controllers import CONTROLLERS

_ABOUT = """\
Opens a window of MuJoCo's viewer on a run and drives it at real time; nothing is
written. Closing the window ends the run. Where there is no screen: exit code 2.
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "view", "watch a run in MuJoCo's viewer", _ABOUT)
    options.add_scenario(parser, writes=False)
    parser.add_argument(
        "--controller", metavar="NAME", help=f"who drives: {', '.join(CONTROLLERS)}"
    )
    parser.add_argument(
        "--seed",
        type=options.seed,
        default=1,
        metavar="N",
        help="draws terrain and noise (default: 1)",
    )
    parser.add_argument(
        "--speed",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="simulated seconds in one of the clock's (default: 1)",
    )
    parser.set_defaults(command=_view)


def _view(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo takes a second to load, and help should not wait.
    from experiments.assembly import assemble
    from experiments.run import drive_into
    from testbed.errors import WindowClosed
    from testbed.window import Window

    overrides = list(arguments.overrides)
    if arguments.controller is not None:
        overrides.append(f'controller.name="{arguments.controller}"')
    _, scenario = load(arguments.scenario, overrides)
    assembly = assemble(scenario, arguments.seed)
    with Window(assembly.plant, arguments.speed) as window:
        try:
            outcome = drive_into(window, assembly)
        except WindowClosed:
            return 0
    return 0 if outcome.status == "completed" else options.EXIT_LOST
