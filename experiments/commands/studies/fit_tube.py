"""`ttempc fit-tube`: fit a tube to the logs of runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..options import EXIT_CHECK_FAILED, add_json

ABOUT = """\
Reads the logs of runs of one scenario, which differ in their seeds, computes the
one-step residuals of its error model, and writes a tube: the disturbance set, the
set of estimation errors, the weights of the ancillary gain, and the provenance of
the data. Every third run is held out to check the fit. To drive in the tube:

  ttempc run --controller ttempc-tube --set controller.tube=tube.json

With --laps-coverage it does not fit: it takes the tube that the runs were driven
in, and adds the half widths that the next run of the scenario keeps as a whole
with this probability (at least 23 runs for 0.95, 123 for 0.99).

The exit code is 1 where the tube is written with a warning: the held-out runs
contradict its coverage, or its runs were not driven in a tube.
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
        metavar="SHARE",
        help="share of all windows inside the disturbance set (default: 0.9)",
    )
    parser.add_argument(
        "--window",
        type=int,
        metavar="STEPS",
        help="steps over which the energy of a disturbance is bounded, 1 for single steps "
        "(default: 10, two seconds)",
    )
    parser.add_argument(
        "--shape",
        choices=("box", "zonotope", "ellipsoid"),
        help="of the disturbance set (default: box)",
    )
    parser.add_argument(
        "--laps-coverage",
        type=float,
        metavar="SHARE",
        help="calibrate the tube of the runs for the next run as a whole",
    )
    add_json(parser, "the tube file")
    parser.set_defaults(command=_fit_tube)


def _fit_tube(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo.
    from ...errors import BadOptions
    from ...output import refuse_existing, write_file
    from ...scenario.tube_file import to_json
    from ...tubes.calibration import calibrate_tube, driven_run, format_calibration
    from ...tubes.fit import fit_run, fit_tube, format_fit
    from ...tubes.logged_runs import read_runs

    options = {name: vars(arguments)[name] for name in ("coverage", "window", "shape")}
    options = {name: value for name, value in options.items() if value is not None}
    if arguments.laps_coverage is not None and options:
        raise BadOptions(
            f"--{next(iter(options))}: not with --laps-coverage, which keeps the set of the tube "
            "that the runs were driven in"
        )
    refuse_existing(arguments.out)
    if arguments.laps_coverage is not None:
        runs = read_runs(arguments.folders, driven_run)
        file, warnings = calibrate_tube(runs, arguments.laps_coverage), ()
        text = format_calibration(file)
    else:
        fit = fit_tube(read_runs(arguments.folders, fit_run), **options)
        file, warnings, text = fit.file, fit.warnings, format_fit(fit)
    written = to_json(file)
    write_file(arguments.out, written)
    print(written if arguments.json else f"{text}\n\ntube      {arguments.out}\n", end="")
    for warning in warnings:
        print(f"ttempc: warning: {warning}", file=sys.stderr)
    return EXIT_CHECK_FAILED if warnings else 0
