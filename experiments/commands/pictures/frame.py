"""`ttempc frame`: take one picture of a run from its log."""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import options

ABOUT = """\
Takes one picture of a run from its log alone, like one frame of `ttempc video`.

  ttempc frame runs/grass-paper-1/log.mcap --at 42.5
  ttempc frame log.mcap --at 42.5 --camera hitch --size 1920x1080 -o hitch.png
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("log", type=options.log_path, metavar="LOG", help="log or folder of a run")
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
    options.add_camera(parser)
    parser.set_defaults(command=_frame)


def _frame(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ...film.composition import FilmSetup
    from ...film.render import write_still
    from ...film.replay import read_replay
    from ...film.shot import Shot, check_within

    name = f"{arguments.camera}-{arguments.at_s:g}.png"
    file = arguments.out or options.path_beside(arguments.log, name)
    replay = read_replay(arguments.log)
    check_within("--at", arguments.at_s, replay.begin_s, replay.end_s)
    size, look = options.picture_size(arguments), options.picture_look(arguments)
    shot = Shot(arguments.camera, replay.begin_s, replay.end_s, 1.0, size, look)
    ghosts = options.read_ghosts(arguments)
    write_still(FilmSetup((replay,), shot, moving=False, ghosts=ghosts), file, arguments.at_s)
    print(f"picture   {file}")
    return 0
