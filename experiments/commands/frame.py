"""`ttempc frame`: one picture of a run from its log."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import options, shots

_ABOUT = """\
Takes one picture of a run from its log alone, as `ttempc video` films it.

  ttempc frame runs/grass-paper-1/log.mcap --at 42.5
  ttempc frame log.mcap --at 42.5 --camera hitch --size 1920x1080 -o hitch.png
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "frame", "one picture of a run from its log", _ABOUT)
    parser.add_argument("log", type=Path, metavar="LOG", help="log.mcap of a run")
    parser.add_argument(
        "--at", type=options.number, required=True, dest="at_s", metavar="S", help="time [s]"
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="picture to write, .png or .jpg (default: beside the log); an existing one is refused",
    )
    shots.add_camera(parser)
    parser.set_defaults(command=_frame)


def _frame(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from ..film.film import still
    from ..film.replay import read_replay
    from ..film.scenes import Setup
    from ..film.shot import Shot, check_within

    name = f"{arguments.camera}-{arguments.at_s:g}.png"
    file = arguments.out or shots.beside(arguments.log, name)
    replay = read_replay(arguments.log)
    check_within("--at", arguments.at_s, replay.begin_s, replay.end_s)
    shot = Shot(arguments.camera, replay.begin_s, replay.end_s, 1.0, arguments.size)
    still(Setup((replay,), shot, moving=False), file, arguments.at_s)
    print(f"picture   {file}")
    return 0
