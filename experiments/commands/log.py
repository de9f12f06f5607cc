"""`ttempc log`: show, export, check, recover or replay a log."""

from __future__ import annotations

import argparse
import json
import sys

from ...testbed.terminal import one_line
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
    out("PLACE", "of tables a folder; default: beside the log"),
    option(
        "--format",
        choices=("csv", "parquet", "rerun"),
        default="csv",
        dest="form",
        help="csv (default), parquet (extra `export`) or rerun (extra `rerun`)",
    ),
)
def export(arguments: argparse.Namespace) -> int:
    """Export a log: tables with a file per topic, or a recording for Rerun."""
    from ...testbed.log.reader import read_content
    from ..logs.export import export_log

    log, form, content = arguments.log, arguments.form, read_content(arguments.log)
    rerun = form == "rerun"
    place = log.with_suffix(".rrd") if rerun else log.with_name(f"{log.stem}-{form}")
    files = export_log(content, arguments.out or place, form)
    note = f", to be opened with: rerun {files[0]}" if rerun else ""
    if content.salvage is not None:
        print(one_line(f"torn or damaged: {content.salvage}"), file=sys.stderr)
    print("\n".join(f"{file}{note}" for file in files))
    return 0


@command(options.LOG, out("NEW.mcap", "the readable part as a whole log; default: none"))
def check(arguments: argparse.Namespace) -> int:
    """Is a log whole, complete, of this version? With -o, recover a torn one."""
    from ...testbed.log.reader import read_content, recover
    from ..logs.check import check_log

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
    option("--estimator", metavar="NAME", help="ekf, nmhe, or package.module:factory of your own"),
    *options.CHANGES,
)
def replay(arguments: argparse.Namespace) -> int:
    """Put the recorded samples and commands through an estimator, without physics.

    Prints for each state the error, the claimed standard deviation and the mean normalised
    error squared (NEES); for each sensor the normalised innovation squared (NIS), the
    autocorrelation of its innovations and their log-likelihood. The first 8 s do not count.

      ttempc log replay LOG.mcap --estimator nmhe --set controller.noise.gnss_sd_m=0.05
    """
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
    print("\n".join(format_consistency(consistency(estimates, record))))
    return 0


log = Group(
    """\
A log is log.mcap of a run's folder, or log.mcap.part of a run that was killed. The
readable part of a torn log is shown and exported, with a note.

  ttempc log info runs/DIR
  ttempc log export runs/DIR --format parquet -o tables
  ttempc log check TORN.part -o NEW.mcap
  ttempc log replay runs/DIR --estimator nmhe

Exit code 0 for success, 1 if `check` finds a log damaged or incomplete, 2 for bad input (one line;
nothing is written).
""",
    {"info": info, "export": export, "check": check, "replay": replay},
)
