"""`ttempc compare`: several runs on one reference, side by side."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from . import options, shots

if TYPE_CHECKING:
    from ..film.scenes import Setup

_ABOUT = """\
Lays runs of one reference over one another, aligned by its time, prints a table
and writes into DIR:

  path.png        the driven paths          error.png   the errors over time
  signals.png     the commands              comparison.csv   the figures, SI units
  comparison.mp4  with --video: all runs side by side at the same time

  ttempc compare runs/grass-paper-1/log.mcap runs/grass-ttempc-nominal-1/log.mcap

Exit code 2 for bad input, as logs of different references (one line; nothing is
written).
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "compare", "several runs side by side", _ABOUT)
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="log.mcap of a run")
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make (default: a new one in runs/); an existing one is refused",
    )
    parser.add_argument("--video", action="store_true", help="film the runs side by side, too")
    shots.add_camera(parser)
    shots.add_span(parser)
    parser.set_defaults(command=_compare)


def _compare(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from ..figures import png
    from ..figures.comparison import COMPARISONS
    from ..output import make_folder, refuse_existing
    from ..results.comparison import read_compared, table, table_csv

    folder = arguments.out or options.fresh(Path("runs"), "comparison")
    refuse_existing(folder)
    runs = read_compared(arguments.logs)
    setup = _setup(arguments) if arguments.video else None
    make_folder(folder)
    print(table(runs) + "\n")
    files = {name: folder / f"{name}.png" for name in COMPARISONS}
    for name, figure in COMPARISONS.items():
        files[name].write_bytes(png(figure(runs)))
    files["figures"] = folder / "comparison.csv"
    files["figures"].write_text(table_csv(runs), encoding="utf-8")
    if setup is not None:
        files["film"] = folder / "comparison.mp4"
        shots.shoot(setup, files["film"], arguments.workers)
    for what, file in files.items():
        print(f"{what:<10}{file}")
    return 0


def _setup(arguments: argparse.Namespace) -> Setup:
    """Return what is to be filmed: from the latest start of all runs to the latest end."""
    from ..film.replay import read_replay
    from ..film.scenes import Setup
    from ..film.shot import spanned

    replays = tuple(read_replay(log) for log in arguments.logs)
    logged_s = max(r.begin_s for r in replays), max(r.end_s for r in replays)
    wanted_s = arguments.begin_s, arguments.end_s
    shot = spanned(arguments.camera, wanted_s, logged_s, arguments.speed, arguments.size)
    setup = Setup(replays, shot)
    setup.check()
    return setup
