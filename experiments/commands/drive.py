"""Commands of one scenario: `run`, `demo`, `serve`, `validate`, `mjcf`."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ...testbed.errors import NoGraphics
from ..output import make_folder, progress, write_file
from ..run.warm_up import compile_in_two_processes
from . import options
from .options import command, json_of, option, out, refuse_given

if TYPE_CHECKING:
    from ...testbed.messages.scenery import Scenery
    from ...testbed.viewers.live import LiveView
    from ..run.assembly import Assembly
    from ..run.run_folder import Finished
    from ..scenario.scenario import Scenario

_DEMO_S: Final = 20.0
_DEMO_SPEED: Final = 4.0  # simulated seconds per second of the film
_DEMO_SIZE: Final = (640, 360)


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.CONTROLLER,
    options.VEHICLE,
    options.SEED,
    json_of("the summary"),
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

      summary.json   the statistics, SI units  log.mcap       all channels, for Foxglove
      scenario.toml  all settings, resolved    report.html    one page with the figures
      *.png          the figures

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
    # Imported here so that --help does not load MuJoCo.
    from ..run.run_folder import Recording, run

    recording = Recording(
        record_hz=arguments.record_rate,
        watch=_live_view(arguments, name) if arguments.live else None,
        shown=not arguments.quiet,
    )
    stem = f"{name}-{scenario.controller.name.replace(':', '-')}-{arguments.seed}"
    finished = run(
        name,
        scenario,
        arguments.seed,
        arguments.out or options.unused_path(Path("runs"), stem),
        recording=recording,
    )
    finished = _with_page(finished)
    if arguments.json:
        print(finished.summary.to_json().rstrip())
    elif not arguments.quiet:
        _print(finished)
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


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
    from ..pictures.film.render import Film
    from ..pictures.film.settings import Camera, FilmSettings
    from ..run.assembly import assemble
    from ..run.run_folder import Recording, run

    def first_seconds(
        scenario: Scenario, seed: int, factory: Callable[..., object] | None
    ) -> Assembly:
        assembly = assemble(scenario, seed, factory)
        ticks = round(_DEMO_S / scenario.control.period_s)
        return replace(assembly, ticks=min(ticks, assembly.ticks))

    name, scenario = options.load_scenario(arguments)
    compile_in_two_processes(arguments)
    folder = arguments.out or options.unused_path(Path("runs"), f"demo-{name}")
    shown = Recording(shown=True)
    finished = run(name, scenario, arguments.seed, folder, make=first_seconds, recording=shown)
    finished = _with_page(finished)
    log = finished.files["log"]
    file = folder / "film.webp"

    def write(camera: Camera) -> None:
        film = Film.of(log, FilmSettings(camera=camera, speed=_DEMO_SPEED, size=_DEMO_SIZE))
        with progress(film.frames, file.name, "frame", shown=True) as count:
            film.write(file, count)

    try:
        write("chase")
    except NoGraphics:
        write("plan")
    _print(finished, film=file)
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _view(arguments: argparse.Namespace, scenario: Scenario) -> int:
    """Drive a run in real time in a window; closing the window ends it."""
    from ...testbed.errors import WindowClosed
    from ...testbed.viewers.window import Window
    from ..run.assembly import assemble
    from ..run.simulate import drive_into

    given = ("out", "json", "quiet", "record_rate")
    refuse_given(arguments, given, "not with --view, which writes nothing")
    assembly = assemble(scenario, arguments.seed)
    with Window(assembly.plant, arguments.speed or 1.0) as window:
        try:
            outcome = drive_into(window, assembly)
        except WindowClosed:
            return 0
    return 0 if outcome.status == "completed" else options.EXIT_LOST


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


def _with_page(finished: Finished) -> Finished:
    """Write page and figures of a run."""
    # Imported here, because matplotlib takes a second to load: a run starts without it.
    from ..pictures.report.run_page import write_page

    return write_page(finished)


def _print(finished: Finished, **further: Path) -> None:
    """Print the results; the last line names what to open."""
    from ..results.mismatch import format_mismatch, mismatch_rows
    from ..results.table import format_events, format_run

    print(format_run(finished.summary))
    for line in format_events(finished.record.events, finished.files["report"].parent):
        print(line)
    given = ", ".join(map(str, finished.mismatch))
    for line in format_mismatch(mismatch_rows(given, finished.summary.learnt)):
        print(line)
    for note in finished.notes:
        print(f"{note[0].upper()}{note[1:]}")
    print()
    for what, file in {**finished.files, **further}.items():
        print(f"{what:<11} {file}")
    print(f"\nopen {finished.files['report']}")


_PORTS: Final = {"json": 8890, "agopengps": 8888, "agopenweb": 8888}


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.SEED,
    option(
        "--protocol", choices=tuple(_PORTS), default="json", help="of the datagrams (default: json)"
    ),
    option(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="to listen on (default: 127.0.0.1, this machine only). With any other, every computer "
        "that reaches it may drive: UDP has neither password nor encryption",
    ),
    option(
        "--port",
        type=options.whole_number(0, 2**16 - 1),
        metavar="N",
        help="to listen on, 0 for any free one (default: 8890, of agopengps 8888)",
    ),
    option(
        "--peer",
        metavar="HOST:PORT",
        help="the only peer that is listened to (default: the first that is understood)",
    ),
    options.SPEED.but(help="simulated seconds per second (default: 1)"),
    option(
        "--step", action="store_true", help="wait for every command instead of keeping the pace"
    ),
    option(
        "--wait",
        type=options.positive,
        default=600.0,
        metavar="S",
        help="time for the peer to start the run, and with --step for each command (default: 600)",
    ),
    option(
        "--hold",
        type=options.positive,
        metavar="S",
        help="simulated time for which the last command is held (default: 1, of agopengps 0.15)",
    ),
)
def serve(arguments: argparse.Namespace) -> int:
    """Drive one scenario in real time with a controller of your own over UDP, and write
    what `ttempc run` writes. docs/integrations.md describes the protocols: json, or
    agopengps with the plant in the place of the modules of AgOpenGPS or AgOpenWeb, whose
    frames tell which of them it is; agopenweb where that is known.

    A command that does not come in time is replaced by the last one; after --hold the
    vehicle stops until there is one again. With --step the plant waits for every command.
    Exit codes as of `ttempc run`; 2 also where no peer came.
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..interfaces.serve.link import Link, address_of, is_local, peer_of, text_of
    from ..interfaces.serve.session import PROTOCOLS, SessionSettings, serve

    if arguments.step:
        refuse_given(arguments, ("speed",), "has no meaning with --step, which keeps no pace")
    port = _PORTS[arguments.protocol] if arguments.port is None else arguments.port
    address = address_of(arguments.host, port, "--host")
    peer = None if arguments.peer is None else peer_of(arguments.peer)
    protocol = PROTOCOLS[arguments.protocol]()
    arguments.overrides = [*protocol.defaults, *arguments.overrides]
    name, scenario = options.load_scenario(arguments)
    compile_in_two_processes(arguments)
    settings = SessionSettings(
        speed=arguments.speed or 1.0,
        lockstep=arguments.step,
        wait_s=arguments.wait,
        hold_s=arguments.hold,
    )
    stem = f"{name}-{arguments.protocol}-{arguments.seed}"
    folder = arguments.out or options.unused_path(Path("runs"), stem)
    with Link(address, peer) as link:
        _say(f"{arguments.protocol} on {text_of(link.address)}, waiting for a peer")
        if not is_local(link.address):
            reach = f"with the address {text_of(peer)}" if peer else "who reaches it"
            _say(f"everyone {reach} may drive: UDP has neither password nor encryption")
        if protocol.defaults:
            _say(
                f"{arguments.protocol}: {', '.join(protocol.defaults)}, unless --set says otherwise"
            )
        finished, totals = serve(
            name, scenario, arguments.seed, folder, link, protocol, settings, _say
        )
    finished = _with_page(finished)
    print(totals)
    _print(finished)
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _say(line: str) -> None:
    print(f"ttempc serve: {line}", file=sys.stderr, flush=True)


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
)
def validate(arguments: argparse.Namespace) -> int:
    """Validate the plant of a scenario in experiments whose results are known without the
    simulation, or published. Write the validation report into DIR: a page to attach to a
    paper, the checks as JSON, the figures. Exit code 1 if a check fails.
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..pictures.report.validation_report import format_check, validation_report

    name, scenario = options.load_scenario(arguments)
    folder = arguments.out or options.unused_path(Path("runs"), f"{name}-validation")
    validation = validation_report(
        name,
        scenario,
        folder,
        on_check=lambda check: print(format_check(check), flush=True),
    )
    print(f"\n{validation.summary_line()}\n\nopen {folder / 'validation.html'}")
    return 0 if validation.passed else options.EXIT_CHECK_FAILED


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.SEED,
)
def mjcf(arguments: argparse.Namespace) -> int:
    """Write a scenario's vehicle on its ground for MuJoCo: scene.xml, with ground.hf where
    the ground is not level; wheels.toml, with ground.npz where the soil varies; drive.py,
    which drives a slalom with the wheels on soil as here. Without this project the
    wheels have MuJoCo's own contact. The keyframe `home` stands at the start. Actuators:
    front steering [rad], drawbar [rad], hydrostat from -1 to 1.

      ttempc mjcf patchy -o patchy
      cd patchy; python drive.py
      python -m mujoco.viewer --mjcf=scene.xml
    """
    # Imported here so that --help does not load MuJoCo.
    from ...testbed.simulation.mjcf_export import mjcf_files
    from ..run.assembly import assemble

    name, scenario = options.load_scenario(arguments)
    folder = arguments.out or options.unused_path(Path("runs"), f"{name}-mjcf-{arguments.seed}")
    assembly = assemble(scenario, arguments.seed)
    assembly.plant.restore(assembly.start)
    files = mjcf_files(assembly.plant)
    make_folder(folder)
    for file, content in files.items():
        write_file(folder / file, content)
        print(folder / file)
    return 0
