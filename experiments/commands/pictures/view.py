"""`ttempc view`: watch a run in MuJoCo's own viewer."""

from __future__ import annotations

import argparse

from .. import options

ABOUT = """\
Drives a run in real time in a window of MuJoCo's viewer; nothing is written.
Closing the window ends the run. Exit code 2 without a screen.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_scenario(parser, writes=False)
    options.add_controller_and_seed(parser)
    parser.add_argument(
        "--speed",
        type=float,
        default=1.0,
        metavar="FACTOR",
        help="simulated time over wall-clock time (default: 1)",
    )
    parser.set_defaults(command=_view)


def _view(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo.
    from ....testbed.errors import WindowClosed
    from ....testbed.viewers.window import Window
    from ...run.assembly import assemble
    from ...run.simulate import drive_into

    _, scenario = options.load_scenario(arguments)
    assembly = assemble(scenario, arguments.seed)
    with Window(assembly.plant, arguments.speed) as window:
        try:
            outcome = drive_into(window, assembly)
        except WindowClosed:
            return 0
    return 0 if outcome.status == "completed" else options.EXIT_LOST
