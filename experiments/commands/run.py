"""`ttempc run`: drive one scenario to its end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import BadOptions
from . import options

if TYPE_CHECKING:
    from proving_ground.testbed.messages.scenery import Scenery
    from proving_ground.testbed.viewers.live import LiveView

ABOUT = """\
Drives one scenario to its end and writes into DIR:

  summary.json   the statistics, SI units  log.mcap       all channels, for Foxglove or Rerun
  scenario.toml  all settings, resolved    report.html    one page with the figures
  *.png          the figures

Exit code 0 if the run ended as planned, 2 for bad input (one line names the key
and the allowed values; nothing is written), 3 if the run terminated early
(roll-over, jack-knife, off the field, stuck, diverged) or the simulation became invalid;
log and summary are written in this case, too.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_scenario(parser)
    options.add_controller_and_seed(parser)
    options.add_json(parser, "the summary")
    parser.add_argument(
        "--record-rate",
        type=float,
        metavar="HZ",
        help="rate at which the truth is recorded (default: 25)",
    )
    live = parser.add_argument_group("live view (extra `live`)")
    live.add_argument(
        "--live",
        action="store_true",
        help="serve the run to Foxglove in real time; its results are the same",
    )
    live.add_argument(
        "--speed", type=float, metavar="FACTOR", help="simulated time over wall-clock time"
    )
    live.add_argument("--port", type=int, metavar="N", help="to serve on (default: 8765)")
    parser.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..results.table import format_run
    from ..run.simulate import run

    name, scenario = options.load_scenario(arguments)
    folder = arguments.out or options.unused_path(
        Path("runs"), f"{name}-{scenario.controller.name.replace(':', '-')}-{arguments.seed}"
    )
    finished = run(
        name,
        scenario,
        arguments.seed,
        folder,
        record_hz=arguments.record_rate,
        watch=_watch(arguments, name),
    )
    if arguments.json:
        print(finished.summary.to_json())
    else:
        print(format_run(finished.summary, finished.comparison))
        if finished.mismatch:
            print(f"Parameter mismatch: {', '.join(map(str, finished.mismatch))}")
        for note in finished.notes:
            print(f"{note[0].upper()}{note[1:]}")
        print()
        for what, file in finished.files.items():
            print(f"{what:<11} {file}")
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _watch(arguments: argparse.Namespace, name: str) -> Callable[[Scenery], LiveView] | None:
    """Return the function that opens the live view, None without --live."""
    from proving_ground.testbed.viewers.live import DEFAULT_PORT, LiveView

    if not arguments.live:
        given = {"--speed": arguments.speed, "--port": arguments.port}
        alone = [option for option, value in given.items() if value is not None]
        if alone:
            raise BadOptions(f"{alone[0]}: goes with --live only")
        return None

    def open_view(scenery: Scenery) -> LiveView:
        view = LiveView(
            scenery,
            name=f"ttempc {name}, seed {arguments.seed}",
            port=DEFAULT_PORT if arguments.port is None else arguments.port,
            speed=1.0 if arguments.speed is None else arguments.speed,
        )
        print(f"live view: {view.url}, in Foxglove: Open connection", file=sys.stderr)
        return view

    return open_view
