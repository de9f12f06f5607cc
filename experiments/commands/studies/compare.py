"""`ttempc compare`: compare several runs on one reference."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import BadOptions
from .. import options

if TYPE_CHECKING:
    from ...film.composition import FilmSetup

ABOUT = """\
Compares runs on one reference, aligned by its time, prints a table and writes
into DIR:

  path.png        the driven paths          error.png   the errors over time
  signals.png     the commands              comparison.csv   the statistics, SI units
  comparison.mp4  with --video: all runs side by side at the same time

  ttempc compare runs/grass-paper-1/log.mcap runs/grass-ttempc-nominal-1/log.mcap

Exit code 2 for bad input, such as logs of different references (one line; nothing
is written).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument(
        "logs", type=options.log_path, nargs="+", metavar="LOG", help="log or folder of a run"
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make (default: a new one in runs/); an existing one is refused",
    )
    parser.add_argument("--video", action="store_true", help="also film the runs side by side")
    options.add_camera(parser)
    options.add_span(parser)
    parser.set_defaults(command=_compare)


def _compare(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ...figures import png
    from ...figures.comparison_figures import COMPARISONS
    from ...output import make_folder, refuse_existing, write_file
    from ...results.run_comparison import comparison_csv, format_comparison, read_compared

    folder = arguments.out or options.unused_path(Path("runs"), "comparison")
    refuse_existing(folder)
    if options.ghost_logs(arguments):
        raise BadOptions("--ghost: takes reference alone here; the film has a panel for every run")
    runs = read_compared(arguments.logs)
    setup = _setup(arguments) if arguments.video else None
    make_folder(folder)
    print(format_comparison(runs) + "\n")
    files = {name: folder / f"{name}.png" for name in COMPARISONS}
    for name, figure in COMPARISONS.items():
        write_file(files[name], png(figure(runs)))
    files["figures"] = folder / "comparison.csv"
    write_file(files["figures"], comparison_csv(runs))
    if setup is not None:
        files["film"] = folder / "comparison.mp4"
        options.write_with_progress(setup, files["film"], arguments.workers)
    for name, file in files.items():
        print(f"{name:<10}{file}")
    return 0


def _setup(arguments: argparse.Namespace) -> FilmSetup:
    """Return the film of all runs, from the latest start to the latest end."""
    from ...film.composition import FilmSetup
    from ...film.replay import read_replay
    from ...film.shot import make_shot

    replays = tuple(read_replay(log) for log in arguments.logs)
    shot = make_shot(
        arguments.camera,
        span_s=(arguments.begin_s, arguments.end_s),
        logged_s=(max(r.begin_s for r in replays), max(r.end_s for r in replays)),
        speed=arguments.speed,
        size=options.picture_size(arguments),
        look=options.picture_look(arguments),
    )
    setup = FilmSetup(replays, shot)
    setup.check()
    return setup
