"""`ttempc video`: film a run from its log."""

from __future__ import annotations

import argparse
from pathlib import Path

from .. import options

ABOUT = """\
Films a run from its log alone; nothing is simulated again. Renders in software
without a GPU; needs no screen. H.264 in MP4, 25 frames a second, plays in
a browser; an animated WebP plays inside a page. On the ground: reference path
(white), driven paths of tractor (blue) and trailer (orange), predicted paths
(yellow). Poles mark the references of both points. Slipping wheels are amber,
then red.

  ttempc video runs/grass-paper-1/log.mcap
  ttempc video log.mcap --camera split --from 20 --to 60 --speed 4 -o curve.mp4
  ttempc video log.mcap --camera plan       no OpenGL needed
  ttempc video log.mcap --ghost reference --exaggerate 10 --quality high
  ttempc video log.mcap --ghost other/log.mcap     two runs in one picture

Exit code 2 for bad input (one line; nothing is written).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("log", type=options.log_path, metavar="LOG", help="log or folder of a run")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE",
        help="film to write, .mp4 or .webp (default: beside the log); an existing one is refused",
    )
    options.add_camera(parser)
    options.add_span(parser)
    parser.set_defaults(command=_video)


def _video(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ...film.composition import FilmSetup
    from ...film.replay import read_replay
    from ...film.shot import FRAME_RATE, make_shot

    file = arguments.out or options.path_beside(arguments.log, f"{arguments.camera}.mp4")
    replay = read_replay(arguments.log)
    shot = make_shot(
        arguments.camera,
        span_s=(arguments.begin_s, arguments.end_s),
        logged_s=(replay.begin_s, replay.end_s),
        speed=arguments.speed,
        size=options.picture_size(arguments),
        look=options.picture_look(arguments),
    )
    setup = FilmSetup((replay,), shot, ghosts=options.read_ghosts(arguments))
    options.write_with_progress(setup, file, arguments.workers)
    count = len(shot.times)
    print(f"film      {file} ({count} frames, {count / FRAME_RATE:.1f} s)")
    return 0
