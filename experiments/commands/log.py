"""`ttempc log` and `ttempc fit`: what a log holds, and what is fitted to logs."""

import argparse
import json
import sys
from pathlib import Path

from ...testbed.terminal import one_line
from ..errors import BadOptions
from ..output import refuse_existing, write_file
from . import options
from .options import Group, command, json_of, option, out


@command(options.LOG, json_of("them"))
def info(arguments: argparse.Namespace) -> int:
    """Run, duration, failure, topics and events of a log."""
    from ...testbed.log.reader import read_content
    from ..logs.check import format_log_info, log_info

    info = log_info(read_content(arguments.log))
    if arguments.json:
        print(json.dumps(info, indent=2, ensure_ascii=True))
    else:
        print("\n".join(map(one_line, format_log_info(info))))
    return 0


@command(
    options.LOG,
    out("DIR", "default: beside the log"),
    option(
        "--format",
        choices=("csv", "parquet"),
        default="csv",
        dest="form",
        help="csv (default) or parquet (extra `export`)",
    ),
)
def export(arguments: argparse.Namespace) -> int:
    """Export a log as tables, a file per topic."""
    from ...testbed.log.reader import read_content
    from ..logs.export import export_log

    log = arguments.log
    form = arguments.form
    content = read_content(arguments.log)
    files = export_log(content, arguments.out or log.with_name(f"{log.stem}-{form}"), form)
    if content.salvage:
        print(one_line(f"torn or damaged: {content.salvage}"), file=sys.stderr)
    print("\n".join(map(str, files)))
    return 0


@command(options.LOG, out("NEW.mcap", "the readable part as a whole log; default: none"))
def check(arguments: argparse.Namespace) -> int:
    """Is a log whole, complete, of this version? With -o, recover a torn one."""
    from ...testbed.log.reader import read_content
    from ..logs.check import check_log, recover

    content = read_content(arguments.log)
    checks = check_log(content)
    if arguments.out is not None:
        recover(content, arguments.out)
    print("\n".join(one_line(str(check)) for check in checks))
    if arguments.out is not None:
        print(f"recovered to {arguments.out}")
    return 0 if all(check.passed for check in checks) else options.EXIT_CHECK_FAILED


@command(
    options.LOG,
    option("--estimator", metavar="NAME", help="ekf, or package.module:factory of your own"),
    *options.CHANGES,
)
def replay(arguments: argparse.Namespace) -> int:
    """Put the recorded samples and commands through an estimator, without physics.

    Prints for each state the error, the claimed standard deviation and the mean normalised
    error squared (NEES); for each sensor the normalised innovation squared (NIS), the
    autocorrelation of its innovations and their log-likelihood. The first 8 s do not count.

      ttempc log replay LOG.mcap --set controller.noise.gnss_sd_m=0.05
    """
    from ...testbed.recording.record import NOT_MEASURED_KEY
    from ..logs.replay import estimator_of, read_run, replay, same_as_recorded
    from ..results.consistency import consistency, format_consistency
    from ..run.user_code import refuse_untrusted
    from ..scenario.scenario import merge_tables, parse_overrides

    changes = parse_overrides(arguments.overrides)
    if arguments.estimator is not None:
        merge_tables(changes, {"controller": {"estimator": arguments.estimator}})
    record, scenario = read_run(arguments.log, changes)
    name = scenario.controller.estimator
    if not arguments.trust:
        refuse_untrusted(arguments.log, [("controller.estimator", name)], changes)
    estimates = replay(record, estimator_of(scenario))
    same = "the" if same_as_recorded(estimates, record) else "other than the"
    run = f"{record.metadata['scenario']}, seed {record.metadata['seed']}"
    print(one_line(f"{run}, estimator {name}: {same} estimates of the run"), end="\n\n")
    if (lacking := record.metadata.get(NOT_MEASURED_KEY, "none")) != "none":
        print(one_line(f"not measured, computed from the track: {lacking}"), end="\n\n")
    print("\n".join(format_consistency(consistency(estimates, record))))
    return 0


@command(
    option("source", type=Path, metavar="FILE", help="record, or folder of a bag"),
    option("--map", type=Path, metavar="MAP.toml", help="names of columns, topics, joints; point"),
    option(
        "--scenario",
        metavar="NAME|FILE",
        help="vehicle, sensors and line of the record (path.file)",
    ),
    option("--vehicle", default="kayacan2016", metavar="NAME|FILE", help="without a scenario"),
    option("--line", default="", metavar="NAME", help="track, where the file has several"),
    option("--seconds", metavar="FROM:TO", help="part of the record, from its beginning"),
    out("LOG.mcap", "default: FILE.mcap in the present folder"),
)
def import_(arguments: argparse.Namespace) -> int:
    """Import a record of another program as a log.

    CSV, NMEA 0183, $PANDA, GPX, KML tracks, time logs of ISOXML, rosbag2, MCAP of ROS 2. What the
    record lacks is computed from its track; the log says what.

      ttempc log import drive.nmea --scenario mine.toml -o drive.mcap
    """
    from ..formats.mapping import read_map
    from ..logs.import_log import import_log
    from ..scenario.scenario import load

    mapping = read_map(arguments.map)
    name = arguments.source.stem
    scenario = None
    if arguments.scenario:
        name, scenario = load(arguments.scenario)
    imported = import_log(
        arguments.source,
        arguments.out or Path(f"{arguments.source.stem}.mcap"),
        mapping,
        scenario,
        name=name,
        vehicle=arguments.vehicle,
        line=arguments.line,
        span_s=options.span(arguments.seconds),
    )
    print("\n".join(map(one_line, imported.lines)))
    print(f"log       {imported.file}")
    return 0


log = Group(
    """\
A log is log.mcap of a run's folder, or log.mcap.part of a run that was killed. The
readable part of a torn log is shown and exported, with a note.

  ttempc log info runs/DIR
  ttempc log export runs/DIR --format parquet -o tables
  ttempc log check TORN.part -o NEW.mcap
  ttempc log import drive.nmea -o drive.mcap
  ttempc log replay runs/DIR --estimator mine:Mine

Exit code 0 for success, 1 if `check` finds a log damaged or incomplete, 2 for bad input (one line;
nothing is written).
""",
    {"info": info, "export": export, "check": check, "import": import_, "replay": replay},
)


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
    from ..studies.tubes.calibration import calibrate_tube, driven_run, format_calibration
    from ..studies.tubes.fit import COVERAGE, fit_run, fit_tube, format_fit, read_runs

    if arguments.laps_coverage is not None and arguments.coverage is not None:
        raise BadOptions("--coverage: not with --laps-coverage, which keeps the set of the tube")
    refuse_existing(arguments.out)
    if arguments.laps_coverage is not None:
        runs = read_runs(arguments.folders, driven_run)
        file = calibrate_tube(runs, arguments.laps_coverage)
        warnings = ()
        text = format_calibration(file)
    else:
        coverage = COVERAGE if arguments.coverage is None else arguments.coverage
        fit = fit_tube(read_runs(arguments.folders, fit_run), coverage)
        file = fit.file
        warnings = fit.warnings
        text = format_fit(fit)
    write_file(arguments.out, to_json(file))
    print(f"{text}\n\ntube      {arguments.out}")
    for warning in warnings:
        print(f"ttempc: warning: {warning}", file=sys.stderr)
    return options.EXIT_CHECK_FAILED if warnings else 0


@command(
    options.LOG,
    out("FILE", "default: fitted.toml").but(default=Path("fitted.toml")),
    json_of("the parameters"),
    *options.CHANGES,
)
def vehicle(arguments: argparse.Namespace) -> int:
    """Fit a vehicle to a log: lengths, dead times, lags, offsets, noise and wheel slip.

    Each value has a standard deviation. The search starts at the vehicle of the log, and lengths
    have a prior of 20 % about it. What the log lacks is left out, and said. To drive it:

      ttempc log import drive.csv --map map.toml -o drive.mcap
      ttempc fit vehicle drive.mcap -o fitted.toml
      ttempc run grass --vehicle fitted.toml
    """
    from ..logs.fit_vehicle import fit_vehicle
    from ..logs.replay import read_run
    from ..scenario.scenario import parse_overrides

    refuse_existing(arguments.out)
    record, scenario = read_run(arguments.log, parse_overrides(arguments.overrides))
    fit = fit_vehicle(record, scenario)
    file = scenario.plant.vehicle.file
    write_file(arguments.out, fit.to_toml(file, arguments.log.name))
    if arguments.json:
        print(fit.to_json().rstrip())
        return 0
    print("\n".join(map(str, fit.parameters)))
    for line in fit.missing:
        print(one_line(f"not fitted: {line}"))
    print(f"\nvehicle   {arguments.out}")
    return 0


fit = Group(
    """\
Fit a tube to the logs of runs, or a vehicle to a log.

  ttempc fit tube runs/grass-* -o tube.json
  ttempc fit vehicle drive.mcap -o fitted.toml
""",
    {"tube": tube, "vehicle": vehicle},
)
