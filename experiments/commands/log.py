"""`ttempc log`: show, export, check, recover, replay, convert or calibrate from a log."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ...testbed.terminal import one_line
from . import options

if TYPE_CHECKING:
    from ...testbed.log.reader import Content

ABOUT = """\
  ttempc log info LOG.mcap                     run, duration, failure, topics, events
  ttempc log export LOG.mcap --out DIR         CSV, one file per topic; --format parquet
  ttempc log rerun LOG.mcap -o FILE.rrd        field, plots and events for Rerun; extra `rerun`
  ttempc log ros2 LOG.mcap -o BAG.mcap         for rosbag2: CDR, standard messages; extra `ros2`
  ttempc log check LOG.mcap                    is it whole, complete, of this version?
  ttempc log check TORN.part --recover NEW.mcap
  ttempc log replay LOG.mcap                   errors and consistency of the estimator
  ttempc log replay LOG.mcap --estimator nmhe --set controller.noise.gnss_sd_m=0.05
  ttempc log calibrate LOG.mcap -o vehicle.toml    lengths of the vehicle, fitted to the log

A log is log.mcap of a run's folder, or log.mcap.part of a run that was killed. The
readable part of a torn log is shown and exported, with a note.

`replay` puts the recorded samples and commands through an estimator, without physics.
For each state it prints the error against the truth, the claimed standard deviation
and the mean normalised estimation error squared (NEES), 1 where the claim is true.
For each sensor: normalised innovation squared (NIS), autocorrelation of the innovations
from one sample to the next, and their log-likelihood, by which two estimators compare
on the same samples. SI units; the first 8 s do not count.

`calibrate` (also `ttempc calibrate`) fits wheelbase, hitch offset, drawbar and trailer
length to the samples and commands, and prints them with their standard deviations. With
-o it writes the scenario's vehicle file with these lengths, for plant.vehicle.file.

Exit code 0 for success, 1 if `check` finds a log damaged or incomplete, 2 for bad input (one line;
nothing is written).
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    actions = parser.add_subparsers(required=True, metavar="ACTION")
    info = actions.add_parser("info", help="run, duration, failure, topics, events")
    options.add_json(info, "them")
    info.set_defaults(command=_info)
    export = actions.add_parser("export", help="tables, one file per topic")
    export.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make (default: LOG-csv or LOG-parquet beside the log)",
    )
    export.add_argument("--format", choices=("csv", "parquet"), default="csv", dest="form")
    export.set_defaults(command=_export)
    rerun = actions.add_parser("rerun", help="a recording for the viewer Rerun, with its layout")
    rerun.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="FILE.rrd",
        help="file to write (default: beside the log)",
    )
    rerun.set_defaults(command=_rerun)
    ros2 = actions.add_parser("ros2", help="a file for the tools of rosbag2 (extra `ros2`)")
    ros2.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="BAG.mcap",
        help="file to write (default: LOG-ros2.mcap beside the log)",
    )
    ros2.set_defaults(command=_ros2)
    check = actions.add_parser("check", help="validate a log, recover a torn one")
    check.add_argument(
        "--recover", type=Path, metavar="NEW.mcap", help="write the readable part as a whole log"
    )
    check.set_defaults(command=_check)
    replay = actions.add_parser("replay", help="put the samples through an estimator again")
    replay.add_argument(
        "--estimator", metavar="NAME", help="ekf, nmhe, or package.module:factory of your own"
    )
    options.add_overrides(replay)
    options.add_trust(replay)
    replay.set_defaults(command=_replay)
    calibrate = actions.add_parser("calibrate", help="fit the lengths of the vehicle")
    calibrate.add_argument(
        "-o", "--out", type=Path, metavar="VEHICLE.toml", help="vehicle file to write"
    )
    calibrate.set_defaults(command=_calibrate)
    for action in (info, export, rerun, ros2, check, replay, calibrate):
        action.add_argument("log", type=options.log_path, metavar="LOG")


def _info(arguments: argparse.Namespace) -> int:
    from ...testbed.log.reader import read_content
    from ..logs.log_check import format_log_info, log_info

    info = log_info(read_content(arguments.log))
    if arguments.json:
        print(json.dumps(info, indent=2, ensure_ascii=True))
    else:
        print("\n".join(map(one_line, format_log_info(info))))
    return 0


def _export(arguments: argparse.Namespace) -> int:
    from ...testbed.log.reader import read_content
    from ..logs.log_export import export_log

    content = read_content(arguments.log)
    folder = arguments.out or arguments.log.with_name(f"{arguments.log.stem}-{arguments.form}")
    files = export_log(content, folder, arguments.form)
    if content.salvage is not None:
        print(one_line(f"torn or damaged: {content.salvage}"), file=sys.stderr)
    print("\n".join(map(str, files)))
    return 0


def _rerun(arguments: argparse.Namespace) -> int:
    from ..logs.rerun_export import export_rerun

    file = arguments.out or arguments.log.with_suffix(".rrd")
    return _converted(arguments.log, file, export_rerun, f", to be opened with: rerun {file}")


def _ros2(arguments: argparse.Namespace) -> int:
    from ..logs.ros2_export import export_ros2

    file = arguments.out or arguments.log.with_name(f"{arguments.log.stem}-ros2.mcap")
    return _converted(arguments.log, file, export_ros2)


def _converted(
    log: Path, file: Path, export: Callable[[Content, Path], object], note: str = ""
) -> int:
    from ...testbed.log.reader import read_content

    content = read_content(log)
    export(content, file)
    if content.salvage is not None:
        print(one_line(f"torn or damaged: {content.salvage}"), file=sys.stderr)
    print(f"{file}{note}")
    return 0


def _check(arguments: argparse.Namespace) -> int:
    from ...testbed.log.reader import read_content, recover
    from ..logs.log_check import check_log

    content = read_content(arguments.log)
    checks = check_log(content)
    if arguments.recover is not None:
        recover(content, arguments.recover)
    print("\n".join(one_line(str(check)) for check in checks))
    if arguments.recover is not None:
        print(f"recovered to {arguments.recover}")
    return 0 if all(check.passed for check in checks) else options.EXIT_CHECK_FAILED


def _replay(arguments: argparse.Namespace) -> int:
    from ..logs.replay import estimator_of, read_run, replay, same_as_recorded
    from ..results.consistency import consistency, format_consistency
    from ..run.user_code import refuse_untrusted
    from ..scenario.scenario import merge_tables, parse_overrides

    changes = parse_overrides(arguments.overrides)
    if arguments.estimator is not None:
        merge_tables(changes, {"controller": {"estimator": arguments.estimator}})
    record, scenario = read_run(arguments.log, changes)
    if not arguments.trust:
        estimator = ("controller.estimator", scenario.controller.estimator)
        refuse_untrusted(arguments.log, [estimator], changes)
    estimates = replay(record, estimator_of(scenario))
    same = same_as_recorded(estimates, record)
    print(
        one_line(
            f"{record.metadata['scenario']}, seed {record.metadata['seed']}, estimator "
            f"{scenario.controller.estimator}: {'the' if same else 'other than the'} estimates of "
            "the run"
        ),
        end="\n\n",
    )
    print("\n".join(format_consistency(consistency(estimates, record))))
    return 0


def _calibrate(arguments: argparse.Namespace) -> int:
    from ..logs.calibrate import calibrate, write_vehicle
    from ..output import refuse_existing

    if arguments.out is not None:
        refuse_existing(arguments.out)
    calibration = calibrate(arguments.log)
    print("\n".join(calibration.format()))
    if arguments.out is not None:
        write_vehicle(calibration, arguments.out)
        print(f"written to {arguments.out}")
    return 0
