"""`ttempc run`: drive one scenario to its end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import BadOptions
from ..results.table import table
from . import options

if TYPE_CHECKING:
    from proving_ground.testbed.messages.scenery import Scenery
    from proving_ground.testbed.viewers.live import LiveView

_ABOUT = """\
Drives one scenario to its end and writes into DIR:

  summary.json   the figures, SI units     log.mcap       everything, for Foxglove or Rerun
  scenario.toml  all settings, resolved    report.html    one page with the figures
  *.png          the figures

Exit code 0 where the run ended as planned, 2 for bad input (one line says what,
where and what is allowed; nothing is written), 3 where the vehicle was lost
(roll-over, jack-knife, left the field, diverged) or the simulation became
invalid; log and summary are written then, too.
"""


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "run", "drive one scenario to its end", _ABOUT)
    options.add_scenario(parser)
    options.add_driver(parser)
    parser.add_argument(
        "--json", action="store_true", help="print summary.json, and nothing else, to stdout"
    )
    parser.add_argument(
        "--record-rate",
        type=float,
        metavar="HZ",
        help="how often the truth is written down (default: 25)",
    )
    live = parser.add_argument_group("live view (extra `live`)")
    live.add_argument(
        "--live",
        action="store_true",
        help="serve the run to Foxglove while it goes on, at real time; the run is the same",
    )
    live.add_argument(
        "--speed", type=float, metavar="FACTOR", help="simulated seconds in one of the clock's"
    )
    live.add_argument("--port", type=int, metavar="N", help="to serve on (default: 8765)")
    parser.set_defaults(command=_run)


def _run(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and matplotlib take two seconds to load, and help should not wait.
    from ..run.assembly import RECORD_RATE_HZ
    from ..run.simulate import run

    name, scenario = options.driven(arguments)
    folder = arguments.out or options.fresh(
        Path("runs"), f"{name}-{scenario.controller.name.replace(':', '-')}-{arguments.seed}"
    )
    finished = run(
        name,
        scenario,
        arguments.seed,
        folder,
        record_hz=RECORD_RATE_HZ if arguments.record_rate is None else arguments.record_rate,
        watch=_watch(arguments, name),
    )
    if arguments.json:
        print(finished.summary.to_json())
    else:
        print(table(finished.summary))
        if finished.mismatch:
            print(f"Believed wrongly: {', '.join(map(str, finished.mismatch))}")
        for note in finished.notes:
            print(f"{note[0].upper()}{note[1:]}")
        print()
        for what, file in finished.files.items():
            print(f"{what:<10}{file}")
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _watch(arguments: argparse.Namespace, name: str) -> Callable[[Scenery], LiveView] | None:
    """Return what opens the live view that was asked for, if any."""
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
