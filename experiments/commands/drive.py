"""`ttempc run` and `ttempc demo`: drive one scenario."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ..errors import BadOptions, NoGraphics
from ..output import make_folder, progress
from ..warm_up import compile_in_two_processes
from . import options
from .options import command, json_of, option, out, refuse_given

if TYPE_CHECKING:
    from ...testbed.messages.scenery import Scenery
    from ...testbed.viewers.live import LiveView
    from ..run.assembly import Assembly
    from ..run.simulate import Finished
    from ..scenario.scenario import Scenario

_DEMO_S: Final = 20.0
_DEMO_SPEED: Final = 4.0  # simulated seconds per second of the film
_DEMO_SIZE: Final = (640, 360)


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.CONTROLLER,
    options.SEED,
    options.SEEDS,
    json_of("the summary, with --seeds a list of them,"),
    options.QUIET,
    option(
        "--record-rate",
        type=float,
        metavar="HZ",
        help="rate at which the truth is recorded (default: 25)",
    ),
    option(
        "--live",
        action="store_true",
        help="serve the run to Foxglove in real time (extra `live`); its results are the same",
        group="viewer",
    ),
    option(
        "--view",
        action="store_true",
        help="drive in a window of MuJoCo's viewer; nothing is written",
        group="viewer",
    ),
    options.SPEED.but(help="simulated seconds per second, of --live and --view (default: 1)"),
    option("--port", type=int, metavar="N", help="of --live (default: 8765)"),
)
def run(arguments: argparse.Namespace) -> int:
    """Drive one scenario to its end and write into DIR:

      summary.json   the statistics, SI units  log.mcap       all channels, for Foxglove or Rerun
      scenario.toml  all settings, resolved    report.html    one page with the figures
      *.png          the figures

    With --seeds each seed has such a folder in DIR; `ttempc sweep` drives more runs in parallel.

    Exit code 0 if the run ended as planned, 2 for bad input (one line; nothing is written),
    3 if it ended early (roll-over, jack-knife, stuck); log and summary are written, too.
    """
    if not (arguments.live or arguments.view):
        refuse_given(arguments, ("speed",), "goes with --live or --view only")
    if not arguments.live:
        refuse_given(arguments, ("port",), "goes with --live only")
    name, scenario = options.load_scenario(arguments)
    compile_in_two_processes(arguments)
    if arguments.view:
        return _view(arguments, scenario)
    numbers = arguments.seeds or (arguments.seed,)
    if arguments.live and arguments.seeds:
        raise BadOptions("--live: shows one run, leave out --seeds")
    stem = f"{name}-{scenario.controller.name.replace(':', '-')}-{numbers[0]}"
    stem += f"-and-{len(numbers) - 1}-more" if len(numbers) > 1 else ""
    folder = arguments.out or options.unused_path(Path("runs"), stem)
    if arguments.seeds:
        make_folder(folder)
        folders = [folder / f"seed-{seed}" for seed in numbers]
    else:
        folders = [folder]
    runs = [
        _drive(arguments, name, scenario, seed, place)
        for seed, place in zip(numbers, folders, strict=True)
    ]
    if arguments.json:
        texts = [run.summary.to_json().rstrip() for run in runs]
        print(f"[{', '.join(texts)}]" if arguments.seeds else texts[0])
    elif not arguments.quiet:
        _print(runs, folder)
    completed = all(run.summary.status == "completed" for run in runs)
    return 0 if completed else options.EXIT_LOST


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.CONTROLLER,
    options.SEED,
)
def demo(arguments: argparse.Namespace) -> int:
    """Drive the first 20 s of a scenario and write what `ttempc run` writes, and a film.

    The film is an animated WebP, which plays in a browser; without OpenGL it is seen from above.
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..film.render import Film
    from ..film.settings import Camera, FilmSettings
    from ..run.assembly import assemble
    from ..run.simulate import run

    def first_seconds(
        scenario: Scenario, seed: int, factory: Callable[..., object] | None
    ) -> Assembly:
        assembly = assemble(scenario, seed, factory)
        ticks = round(_DEMO_S / scenario.control.period_s)
        return replace(assembly, ticks=min(ticks, assembly.ticks))

    name, scenario = options.load_scenario(arguments)
    compile_in_two_processes(arguments)
    folder = arguments.out or options.unused_path(Path("runs"), f"demo-{name}")
    finished = run(name, scenario, arguments.seed, folder, shown=True, make=first_seconds)
    log, file = finished.files["log"], folder / "film.webp"

    def write(camera: Camera) -> None:
        film = Film.of([log], FilmSettings(camera=camera, speed=_DEMO_SPEED, size=_DEMO_SIZE))
        with progress(film.frames, file.name, "frame", shown=True) as count:
            film.write(file, count)

    try:
        write("chase")
    except NoGraphics:
        write("plan")
    _print([finished], folder, film=file)
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _view(arguments: argparse.Namespace, scenario: Scenario) -> int:
    """Drive a run in real time in a window; closing the window ends it."""
    from ...testbed.errors import WindowClosed
    from ...testbed.viewers.window import Window
    from ..run.assembly import assemble
    from ..run.simulate import drive_into

    given = ("out", "seeds", "json", "quiet", "record_rate")
    refuse_given(arguments, given, "not with --view, which writes nothing")
    assembly = assemble(scenario, arguments.seed)
    with Window(assembly.plant, arguments.speed or 1.0) as window:
        try:
            outcome = drive_into(window, assembly)
        except WindowClosed:
            return 0
    return 0 if outcome.status == "completed" else options.EXIT_LOST


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
        watch=_live_view(arguments, name) if arguments.live else None,
        shown=not arguments.quiet,
    )


def _live_view(arguments: argparse.Namespace, name: str) -> Callable[[Scenery], LiveView]:
    """Return the function that opens the live view."""
    from ...testbed.viewers.live import DEFAULT_PORT, PROTOCOL, LiveView

    def open_view(scenery: Scenery) -> LiveView:
        view = LiveView(
            scenery,
            name=f"ttempc {name}, seed {arguments.seed}",
            port=DEFAULT_PORT if arguments.port is None else arguments.port,
            speed=arguments.speed or 1.0,
        )
        print(
            f"live view: {view.url}, in Foxglove: Open connection; protocol {PROTOCOL}",
            file=sys.stderr,
        )
        return view

    return open_view


def _print(runs: Sequence[Finished], folder: Path, **further: Path) -> None:
    """Print the results; the last line names what to open."""
    from ..results.table import format_events, format_run, format_seeds

    if len(runs) > 1:
        print(format_seeds([run.summary for run in runs]))
        print(f"\nopen {folder / 'seed-*' / 'report.html'}")
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
    for what, file in {**finished.files, **further}.items():
        print(f"{what:<11} {file}")
    print(f"\nopen {finished.files['report']}")
