"""`ttempc fit-tube`: fit a tube to the logs of runs."""

from __future__ import annotations

import argparse
from pathlib import Path

ABOUT = """\
Reads the logs of runs of one vehicle, computes the one-step residuals of its
error model, and writes a tube: the disturbance set, the set of estimation
errors, the weights of the ancillary gain, and the provenance of the data. Every
third run is held out to check the fit. To drive in the tube:

  ttempc run --controller ttempc-tube --set controller.tube='"tube.json"'
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
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
        help="share of all windows inside the disturbance set (default: 0.9)",
    )
    parser.add_argument(
        "--window",
        type=int,
        default=10,
        metavar="STEPS",
        help="steps over which the energy of a disturbance is bounded, 1 for single steps "
        "(default: 10, two seconds)",
    )
    parser.add_argument(
        "--shape",
        choices=("box", "zonotope", "ellipsoid"),
        default="box",
        help="of the disturbance set (default: box)",
    )
    parser.set_defaults(command=_fit_tube)


def _fit_tube(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo.
    from ..output import refuse_existing, write_file
    from ..scenario.tube_file import to_json
    from ..tubes.fit import fit_tube, format_fit, read_fit_runs

    refuse_existing(arguments.out)
    runs = read_fit_runs(arguments.folders)
    fit = fit_tube(runs, arguments.coverage, arguments.window, arguments.shape)
    write_file(arguments.out, to_json(fit.file))
    print(f"{format_fit(fit)}\n\ntube      {arguments.out}")
    return 0
