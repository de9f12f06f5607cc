"""`ttempc fit-tube`: a tube from the logs of runs."""

from __future__ import annotations

import argparse
from pathlib import Path

from . import options

_ABOUT = """\
Reads the logs of runs of one vehicle, measures what its error model leaves
unexplained, and writes the tube that follows: the set of disturbances, the
error of the estimate, the gain that keeps the vehicle near its nominal state,
and where all of it comes from. Every third run is held out to check the fit.
Drive in the tube with

  ttempc run --controller ttempc-tube --set controller.tube='"tube.json"'
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "fit-tube", "fit a tube to the logs of runs", _ABOUT)
    parser.add_argument(
        "folders", nargs="+", type=Path, metavar="DIR", help="folder of a run, or of many"
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        default=Path("tube.json"),
        metavar="FILE",
        help="to write; an existing one is refused (default: tube.json)",
    )
    parser.add_argument(
        "--coverage",
        type=float,
        default=0.9,
        metavar="SHARE",
        help="of all windows that shall lie in the set (default: 0.9)",
    )
    parser.add_argument(
        "--window",
        type=int,
        default=10,
        metavar="STEPS",
        help="steps over which the energy of a disturbance is bounded, 1 for every step by itself "
        "(default: 10, two seconds)",
    )
    parser.add_argument(
        "--shape",
        choices=("box", "zonotope", "ellipsoid"),
        default="box",
        help="of the set of disturbances (default: box)",
    )
    parser.set_defaults(command=_fit_tube)


def _fit_tube(arguments: argparse.Namespace) -> int:
    # Here, because help should not wait for what loads slowly.
    from ..output import begin_part, refuse_existing
    from ..scenario.tube_file import to_json
    from ..tubes.fit import fit_tube, read_runs
    from ..tubes.tube_table import tube_table

    refuse_existing(arguments.out)
    runs = read_runs(arguments.folders)
    fit = fit_tube(runs, arguments.coverage, arguments.window, arguments.shape)
    part = begin_part(arguments.out)
    part.write_text(to_json(fit.file), encoding="utf-8")
    part.rename(arguments.out)
    print(f"{tube_table(fit)}\n\ntube      {arguments.out}")
    return 0
