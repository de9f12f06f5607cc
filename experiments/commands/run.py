"""`ttempc run`: drive one scenario to its end."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ...testbed.terminal import one_line
from ..errors import BadOptions
from ..output import make_folder
from . import options

if TYPE_CHECKING:
    from ...testbed.messages.scenery import Scenery
    from ...testbed.recording.record import Event
    from ...testbed.viewers.live import LiveView
    from ..run.simulate import Finished
    from ..scenario.scenario import Scenario

ABOUT = """\
Drives one scenario to its end and writes into DIR:

  summary.json   the statistics, SI units  log.mcap       all channels, for Foxglove or Rerun
  scenario.toml  all settings, resolved    report.html    one page with the figures
  *.png          the figures

With --seeds each seed has such a folder in DIR; `ttempc sweep` drives more runs in parallel.

Exit code 0 if the run ended as planned, 2 for bad input (one line names the key
and the allowed values; nothing is written), 3 if the run terminated early
(roll-over, jack-knife, off the field, stuck, diverged) or the simulation became invalid;
log and summary are written in this case, too.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_scenario(parser)
    options.add_controller_and_seed(parser)
    parser.add_argument(
        "--seeds",
        type=options.whole_number(2, 1000),
        metavar="COUNT",
        help="drive this many seeds from --seed on, a folder for each, and print a table of all",
    )
    options.add_json(parser, "the summary, with --seeds a list of them,")
    options.add_verbosity(parser, "the events of a run as they occur")
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
    name, scenario = options.load_scenario(arguments)
    controller = scenario.controller.name.replace(":", "-")
    first, count = arguments.seed, arguments.seeds or 1
    stem = f"{name}-{controller}-{first}" + (f"-to-{first + count - 1}" if count > 1 else "")
    folder = arguments.out or options.unused_path(Path("runs"), stem)
    runs = [_drive(arguments, name, scenario, first, folder)] if count == 1 else []
    if count > 1:
        if arguments.live:
            raise BadOptions("--live: shows one run, leave out --seeds")
        make_folder(folder)
        for seed in range(first, first + count):
            runs.append(_drive(arguments, name, scenario, seed, folder / f"seed-{seed}"))
    summaries = [run.summary for run in runs]
    if arguments.json:
        texts = [summary.to_json().rstrip() for summary in summaries]
        print(texts[0] if count == 1 else f"[{', '.join(texts)}]")
    elif not arguments.quiet:
        _print(runs, folder)
    completed = all(summary.status == "completed" for summary in summaries)
    return 0 if completed else options.EXIT_LOST


def _drive(
    arguments: argparse.Namespace, name: str, scenario: Scenario, seed: int, folder: Path
) -> Finished:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..run.simulate import run

    return run(
        name,
        scenario,
        seed,
        folder,
        record_hz=arguments.record_rate,
        watch=_watch(arguments, name),
        on_event=_print_event if arguments.verbose else None,
        progress=sys.stderr.isatty() and not arguments.quiet,
    )


def _print_event(event: Event) -> None:
    from tqdm import tqdm

    line = f"{event.time_s:8.2f} s  {event.level:<8}{event.text}"
    tqdm.write(one_line(line), file=sys.stderr)


def _print(runs: Sequence[Finished], folder: Path) -> None:
    from ..results.table import format_events, format_run, format_seeds

    if len(runs) > 1:
        print(format_seeds([run.summary for run in runs]))
        print(f"\nreports    {folder / 'seed-*' / 'report.html'}")
        return
    (finished,) = runs
    print(format_run(finished.summary, finished.comparison))
    for line in format_events(finished.record.events, folder):
        print(line)
    if finished.mismatch:
        print(f"Parameter mismatch: {', '.join(map(str, finished.mismatch))}")
    for note in finished.notes:
        print(f"{note[0].upper()}{note[1:]}")
    print()
    for what, file in finished.files.items():
        print(f"{what:<11} {file}")


def _watch(arguments: argparse.Namespace, name: str) -> Callable[[Scenery], LiveView] | None:
    """Return the function that opens the live view, None without --live."""
    from ...testbed.viewers.live import DEFAULT_PORT, PROTOCOL, LiveView

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
        print(
            f"live view: {view.url}, in Foxglove: Open connection; protocol {PROTOCOL}",
            file=sys.stderr,
        )
        return view

    return open_view
