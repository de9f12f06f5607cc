"""`ttempc falsify`: search for the least severe case that a controller fails."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import BadOptions
from .. import options

if TYPE_CHECKING:
    from ...search.search import Report

ABOUT = """\
Searches bounded quantities of a scenario for the least severe case in which the run
terminates early, leaves the corridor, or exceeds a limit on the trailer's 95 %
cross-track error. Severity is the distance from the nominal values, in units of the
bounds. QUANTITY is one of

  cone-index slope speed delay roughness              those of `ttempc envelope`
  gust ditch soil-patch gnss-noise angle-noise
  gnss-outage late-commands stuck-front stuck-trailer faults, at any place of the path
  KEY=LOW:HIGH      a key of the scenario, e.g. soil.cone_index_kpa=200:600
  KEY=LOW:HIGH:free a key without severity, e.g. terrain.uphill_deg=0:360:free

Writes into DIR falsification.json, worst/*.toml (scenarios that `ttempc run` replays)
and generations/ (the rows of all runs). The same command continues an interrupted
search. With --probability also estimates the probability of failure (docs/worst-cases.md).

Exit code 0 if the search completed, 2 for bad input (one line, no run made), 130 if it was
interrupted.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("quantity", nargs="+", metavar="QUANTITY", help="quantity to search")
    parser.add_argument(
        "scenario", metavar="SCENARIO", help="name of a shipped scenario or path of a .toml file"
    )
    options.add_controller_and_seed(parser)
    parser.add_argument(
        "--budget",
        type=options.whole_number(1),
        default=100,
        metavar="N",
        help="runs of the search (default: 100)",
    )
    parser.add_argument(
        "--limit",
        type=options.number,
        metavar="M",
        help="a run fails above this 95 %% cross-track error of the trailer, in m (default: not "
        "limited)",
    )
    parser.add_argument(
        "--probability",
        type=options.whole_number(50),
        metavar="N",
        help="estimate the probability of failure with N runs per level, a multiple of 10; levels "
        "are a factor of 10 apart",
    )
    parser.add_argument(
        "-o",
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to make or to continue (default: runs/falsify-SCENARIO-CONTROLLER)",
    )
    options.add_overrides(parser)
    options.add_trust(parser)
    options.add_workers(parser)
    options.add_json(parser, "the report")
    parser.set_defaults(command=_falsify)


def _falsify(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and Dask.
    from ...run.assembly import check
    from ...scenario.scenario import merge_tables, parse_overrides, read_scenario
    from ...search.quantities import read_subject
    from ...search.search import Search
    from ...sweep.engine import engine

    if arguments.probability and arguments.probability % 10:
        raise BadOptions(
            f"--probability: must be a multiple of 10 from 50, got {arguments.probability}"
        )
    name, scenario = options.load_scenario(arguments)
    check(scenario)
    settings = parse_overrides(arguments.overrides)
    if arguments.controller is not None:
        merge_tables(settings, {"controller": {"name": arguments.controller}})
    draft = read_scenario(arguments.scenario)
    subject = read_subject(draft, arguments.scenario, settings, arguments.quantity)
    controller = scenario.controller.name.replace(":", "-")
    folder: Path = arguments.out or Path("runs") / f"falsify-{name}-{controller}"

    def show(runs: int) -> None:
        if not arguments.json:
            print(f"{runs} run{'s' if runs > 1 else ''}", file=sys.stderr, flush=True)

    try:
        with engine(arguments.workers, arguments.dask) as workers:
            search = Search(subject, workers, arguments.seed, arguments.limit, folder, show)
            search.falsify(arguments.budget)
            samples = arguments.probability
            report = search.report(search.probability(samples) if samples else None)
    except KeyboardInterrupt:
        print(f"ttempc: interrupted; the same command carries on in {folder}", file=sys.stderr)
        return options.EXIT_INTERRUPTED
    print(report.to_json() if arguments.json else _text(report, folder), end="")
    return 0


def _text(report: Report, folder: Path) -> str:
    """Return the report as lines of text, with the commands that replay its cases."""
    lines = [
        f"{report.controller} on {report.scenario}, seed {report.seed}: "
        f"{report.failed} of {report.runs} runs failed, {report.without_result} without a result"
    ]
    for case in report.cases:
        values = ", ".join(
            f"{key} = {value:g}" if isinstance(value, float) else f"{key} = {value}"
            for key, value in case.values.items()
        )
        end = case.failure or f"no failure; robustness {case.robustness:.2f} is the least"
        lines += ["", f"severity {case.severity:.3f}: {end}", f"  {values}"]
        run = folder / Path(case.file).stem
        lines += [
            f"  ttempc run {folder / case.file} --seed {report.seed} --out {run}",
            f"  ttempc video {run / 'log.mcap'}",
        ]
    if (found := report.probability) is not None:
        estimate = (
            f"at most {found.high:.2g}"
            if found.estimate is None
            else f"{found.estimate:.2g} (95 % interval {found.low:.2g} to {found.high:.2g})"
        )
        lines += ["", f"probability of failure {estimate}, {found.samples} runs"]
    return "\n".join([*lines, f"report    {folder / 'falsification.json'}"]) + "\n"
