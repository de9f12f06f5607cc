"""`ttempc fit`: fit a tube or the lengths of the vehicle to the logs of runs."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..errors import BadOptions
from ..output import refuse_existing, write_file
from . import options
from .options import EXIT_CHECK_FAILED, Group, command, json_of, option, out


@command(
    option("folders", nargs="+", type=Path, metavar="DIR", help="folder of a run, or of many"),
    out("FILE", "default: tube.json").but(default=Path("tube.json")),
    option(
        "--coverage",
        type=float,
        metavar="SHARE",
        help="share of all windows inside the disturbance set (default: 0.9)",
    ),
    option(
        "--laps-coverage",
        type=float,
        metavar="SHARE",
        help="calibrate the tube of the runs for the next run as a whole",
    ),
    json_of("the tube file"),
)
def tube(arguments: argparse.Namespace) -> int:
    """Fit a tube to the logs of runs of one scenario, which differ in their seeds.

    Every third run is held out to check the fit. To drive in the tube:

      ttempc run --controller ttempc-tube --set controller.tube=tube.json

    With --laps-coverage it takes the tube that the runs were driven in, and adds the half
    widths that the next run keeps as a whole with this probability (at least 23 runs for
    0.95, 123 for 0.99). Exit code 1 where the tube is written with a warning.
    """
    # Imported here so that --help does not load MuJoCo.
    from ..scenario.tube_file import to_json
    from ..tubes.calibration import calibrate_tube, driven_run, format_calibration
    from ..tubes.fit import COVERAGE, fit_run, fit_tube, format_fit
    from ..tubes.logged_runs import read_runs

    if arguments.laps_coverage is not None and arguments.coverage is not None:
        raise BadOptions("--coverage: not with --laps-coverage, which keeps the set of the tube")
    refuse_existing(arguments.out)
    if arguments.laps_coverage is not None:
        runs = read_runs(arguments.folders, driven_run)
        file, warnings = calibrate_tube(runs, arguments.laps_coverage), ()
        text = format_calibration(file)
    else:
        coverage = COVERAGE if arguments.coverage is None else arguments.coverage
        fit = fit_tube(read_runs(arguments.folders, fit_run), coverage)
        file, warnings, text = fit.file, fit.warnings, format_fit(fit)
    written = to_json(file)
    write_file(arguments.out, written)
    print(written if arguments.json else f"{text}\n\ntube      {arguments.out}\n", end="")
    for warning in warnings:
        print(f"ttempc: warning: {warning}", file=sys.stderr)
    return EXIT_CHECK_FAILED if warnings else 0


@command(options.LOG, out("VEHICLE.toml", "default: none"))
def vehicle(arguments: argparse.Namespace) -> int:
    """Fit wheelbase, hitch offset, drawbar and trailer length to the samples of a run.

    Prints them with their standard deviations. With -o it writes the scenario's vehicle file
    with these lengths, for plant.vehicle.file.
    """
    from ..logs.calibrate import calibrate

    if arguments.out is not None:
        refuse_existing(arguments.out)
    calibration = calibrate(arguments.log)
    print("\n".join(calibration.format()))
    if arguments.out is not None:
        write_file(arguments.out, calibration.file)
        print(f"written to {arguments.out}")
    return 0


fit = Group(
    """\
Fit parts of a controller to the logs of runs.

  ttempc fit tube runs/grass-* -o tube.json
  ttempc fit vehicle runs/DIR -o vehicle.toml
""",
    {"tube": tube, "vehicle": vehicle},
)
