"""`ttempc compare`: compare several runs on one reference."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import BadOptions
from .. import options
from ..figure_options import add_figure_files, chosen_figures, write_figures

if TYPE_CHECKING:
    from ...film.composition import FilmSetup

ABOUT = """\
Compares runs on one reference, aligned by its time, prints a table and writes
into DIR:

  path, error, signals  figures of driven paths, of errors over time and of commands,
                        each with the data that it shows as CSV
  comparison.csv        the statistics, SI units
  comparison.mp4        with --video: all runs side by side at the same time

  ttempc compare runs/grass-paper-1 runs/grass-ttempc-nominal-1
  ttempc compare runs/grass-pid-1 runs/grass-ttempc-1 --format pdf,svg --width single

Exit code 2 for bad input, such as logs of different references (one line; nothing
is written).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    # Imported here because only this command needs it, and it loads matplotlib.
    from ...figures.comparison_figures import COMPARISONS

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
    add_figure_files(parser, default="png", names=f"of {', '.join(COMPARISONS)} (default: all)")
    parser.add_argument("--video", action="store_true", help="also film the runs side by side")
    options.add_camera(parser)
    options.add_span(parser)
    parser.set_defaults(command=_compare)


def _compare(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ...figures.comparison_figures import comparison_figures
    from ...output import make_folder, refuse_existing, write_file
    from ...results.run_comparison import (
        STATISTICS_FILE,
        comparison_csv,
        format_comparison,
        read_compared,
    )

    folder = arguments.out or options.unused_path(Path("runs"), "comparison")
    refuse_existing(folder)
    if options.ghost_logs(arguments):
        raise BadOptions("--ghost: takes reference alone here; the film has a panel for every run")
    runs = read_compared(arguments.logs)
    figures = chosen_figures(arguments, comparison_figures(runs), "compare")
    setup = _setup(arguments) if arguments.video else None
    make_folder(folder)
    print(format_comparison(runs) + "\n")
    write_figures(arguments, figures, folder)
    write_file(folder / STATISTICS_FILE, comparison_csv(runs))
    print(folder / STATISTICS_FILE)
    if setup is not None:
        film = folder / "comparison.mp4"
        options.write_with_progress(setup, film, arguments.workers)
        print(film)
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
