"""`ttempc view`: watch a run in MuJoCo's own viewer."""

from __future__ import annotations

import argparse

from . import options

_ABOUT = """\
Opens a window of MuJoCo's viewer on a run and drives it at real time; nothing is
written. Closing the window ends the run. Where there is no screen: exit code 2.
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "view", "watch a run in MuJoCo's viewer", _ABOUT)
    options.add_scenario(parser, writes=False)
    options.add_driver(parser)
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
    from proving_ground.testbed.errors import WindowClosed
    from proving_ground.testbed.viewers.window import Window

    from ..run.assembly import assemble
    from ..run.simulate import drive_into

    _, scenario = options.driven(arguments)
    assembly = assemble(scenario, arguments.seed)
    with Window(assembly.plant, arguments.speed) as window:
        try:
            outcome = drive_into(window, assembly)
        except WindowClosed:
            return 0
    return 0 if outcome.status == "completed" else options.EXIT_LOST
