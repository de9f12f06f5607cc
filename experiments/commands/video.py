"""`ttempc video`: film a run from its log."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import options, shots

_ABOUT = """\
Films a run from its log alone; nothing is simulated again. Rendered in software
where there is no GPU; needs no screen. H.264 in MP4, 25 frames a second, plays in
a browser. On the ground: reference path (white), driven paths of tractor (blue)
and trailer (orange), predicted paths (yellow). Poles stand where both points
should be; wheels turn amber and red as they slip.

  ttempc video runs/grass-paper-1/log.mcap
  ttempc video log.mcap --camera split --from 20 --to 60 --speed 4 -o curve.mp4
  ttempc video log.mcap --camera plan       no OpenGL needed

Exit code 2 for bad input (one line; nothing is written).
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "video", "film a run from its log", _ABOUT)
    parser.add_argument("log", type=Path, metavar="LOG", help="log.mcap of a run")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="film to write, .mp4 (default: beside the log); an existing one is refused",
    )
    shots.add_camera(parser)
    shots.add_span(parser)
    parser.set_defaults(command=_video)


def _video(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from ..film.replay import read_replay
    from ..film.scenes import Setup
    from ..film.shot import FRAME_RATE, spanned

    file = arguments.out or shots.beside(arguments.log, f"{arguments.camera}.mp4")
    replay = read_replay(arguments.log)
    shot = spanned(
        arguments.camera,
        (arguments.begin_s, arguments.end_s),
        (replay.begin_s, replay.end_s),
        arguments.speed,
        arguments.size,
    )
    shots.shoot(Setup((replay,), shot), file, arguments.workers)
    count = len(shot.times)
    print(f"film      {file} ({count} frames, {count / FRAME_RATE:.1f} s)")
    return 0
