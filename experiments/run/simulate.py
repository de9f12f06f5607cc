"""A run: scenario and seed -> plant, sensors and guidance -> drive -> record -> summary.

`simulate` keeps it in memory, `run` writes a folder, `drive_into` drives. Parts: `assembly.py`,
`testbed/simulation/loop.py`, `testbed/log/writer.py`, `experiments/results/summary.py`.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from ...testbed.geodesy import ORIGIN_KEY
from ...testbed.ground.ground import GROUND_FILE
from ...testbed.log import LOG_NAME
from ...testbed.log.reader import RECOVERED_KEY, SALVAGED_KEY
from ...testbed.log.writer import LogWriter
from ...testbed.messages.scenery import Scenery
from ...testbed.recording.channels import REFERENCE_PATH_TOPIC
from ...testbed.recording.provenance import machine, versions
from ...testbed.recording.record import Event, Record, Recorder, Sink, Tee
from ...testbed.simulation.loop import Outcome, drive, prepare
from ...testbed.vehicle.vehicle import VEHICLES
from ..output import make_folder, progress, refuse_existing, write_file
from ..results.summary import RunFacts, Summary, summarise
from ..scenario.controller import OptionValue
from ..scenario.plant import record_steps
from ..scenario.scenario import Scenario, dump, identity
from ..scenario.vehicle import ParameterMismatch
from .assembly import Assembly, assemble
from .shared_parts import SharedParts
from .user_code import exits_raise, name_of, user_sources

if TYPE_CHECKING:
    from ...testbed.viewers.live import LiveView

BEGINS: Final = "run begins: "
ENDS: Final = "run ends: "
"""Beginnings of the two lines that a log has beside the events of the run's record."""

_OF_THE_RUN: Final = (
    *("scenario", "controller", "seed", "started", "machine", "mismatch"),
    ORIGIN_KEY,
)
_PATH_STEP_M: Final = 0.2  # between the points of the reference path in the log


@dataclass(frozen=True, slots=True)
class Finished:
    """What a run left."""

    summary: Summary
    record: Record
    files: Mapping[str, Path]  # "log", "summary", "scenario", "report" and each figure
    mismatch: tuple[ParameterMismatch, ...]  # between plant and model
    notes: tuple[str, ...] = ()  # on path and tube


@exits_raise()
def simulate(
    name: str,
    scenario: Scenario,
    seed: int,
    factory: Callable[..., object] | None = None,
    log: Path | None = None,
    *,
    options: Mapping[str, OptionValue] | None = None,
    parts: SharedParts | None = None,
) -> tuple[Summary, Record]:
    """Run a scenario in memory and return its numbers; nothing is written but the log, if asked.

    The controller does not prepare its steps: its computation times are those of cold caches.

    Args:
        name, scenario: what to run.
        seed: draws terrain and noise.
        factory: makes a controller of your own from vehicle, reference and control period [s]. The
            run is filed under its name `module:qualname` and a hash of its source.
        options: keyword options of the factory.
        log: file to write the log to, in a folder that exists.
        parts: of earlier runs, to be used again; none by default.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible.
    """
    scenario, sources = _with_controller(scenario, factory, options)
    assembly = assemble(scenario, seed, factory, parts)
    recorder = Recorder()
    if log is None:
        outcome = drive_into(recorder, assembly, prepared=False)
    else:
        metadata = describe(name, scenario, seed, assembly, sources)
        with open_log(log, scenario, assembly, assembly.scenery, metadata) as writer:
            writer.event(first_line(metadata))
            outcome = drive_into(Tee(recorder, writer), assembly, prepared=False)
            writer.event(last_line(outcome))
    del assembly  # plant and horizons: the summary of a long run takes their memory
    record, file = recorder.record(), log and log.name
    return _summarise(record, name, scenario, seed, outcome, file, sources), record


@exits_raise()
def run(
    name: str,
    scenario: Scenario,
    seed: int,
    folder: Path,
    *,
    record_hz: float | None = None,
    watch: Callable[[Scenery], LiveView] | None = None,
    on_event: Callable[[Event], object] | None = None,
    shown: bool | None = None,
    factory: Callable[..., object] | None = None,
    options: Mapping[str, OptionValue] | None = None,
    make: Callable[[Scenario, int, Callable[..., object] | None], Assembly] = assemble,
) -> Finished:
    """Run a scenario and write log, summary, resolved scenario, figures and report to `folder`.

    Args:
        name, scenario: what to run.
        seed: draws terrain and noise.
        folder: to make.
        record_hz: how often the truth is written down [Hz]; None: as in `record_rate`.
        watch: opens a live view of the run; it gets the same data as the log.
        on_event: called with every event when it occurs.
        shown: whether to show progress, see `output.progress`.
        factory, options: as in `simulate`.
        make: makes the objects of the run from scenario, seed and factory.

    Raises:
        OutputExists: the folder exists already; nothing is written.
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            nothing is written.
    """
    refuse_existing(folder)
    scenario, sources = _with_controller(scenario, factory, options)
    assembly = make(scenario, seed, factory)
    if record_hz is not None:  # refused here, before anything is written
        record_steps(assembly.plant.timestep_s, assembly.guidance.period_s, record_hz)
    scenery = assembly.scenery
    with ExitStack() as stack:
        views = [stack.enter_context(watch(scenery))] if watch else []
        make_folder(folder)
        resolved = dump(scenario)
        files = {"scenario": folder / "scenario.toml", "log": folder / LOG_NAME}
        write_file(files["scenario"], resolved)
        metadata = describe(name, scenario, seed, assembly, sources)
        recorder = Recorder(on_event=on_event)
        log = stack.enter_context(open_log(files["log"], scenario, assembly, scenery, metadata))
        what = f"{name}, {scenario.controller.name}, seed {seed}"
        count = stack.enter_context(progress(assembly.ticks, what, "tick", shown))
        viewers = Tee(log, *views)  # who read of the run's start and end
        viewers.event(first_line(metadata))
        sink = Tee(recorder, viewers)
        outcome = drive_into(sink, assembly, record_hz, lambda k: count())
        viewers.event(last_line(outcome))
    mismatch, notes = assembly.mismatch, assembly.notes
    del assembly  # plant and horizons: record and figures of a long run take their memory
    record = recorder.record(metadata)
    summary = _summarise(record, name, scenario, seed, outcome, files["log"].name, sources)
    files["summary"] = folder / "summary.json"
    write_file(files["summary"], summary.to_json())
    # Here, because matplotlib takes a second to load: a run starts without it.
    from ..pictures.figures import draw
    from ..pictures.report.run_report import render_run_report

    pictures = draw(record)
    for figure, content in pictures.items():
        files[figure] = folder / f"{figure}.png"
        write_file(files[figure], content)
    files["report"] = folder / "report.html"
    page = render_run_report(summary, record, resolved, pictures, description=scenario.description)
    write_file(files["report"], page)
    return Finished(summary, record, files, mismatch, notes)


def drive_into(
    sink: Sink,
    assembly: Assembly,
    record_hz: float | None = None,
    on_tick: Callable[[int], object] = lambda k: None,
    *,
    prepared: bool = True,
) -> Outcome:
    """Drive a run to its end and write it into the sink, the reference path first.

    `on_tick` is called after every control period. `prepared`: the controller prepares its steps,
    which shortens them and costs more than it saves; the bits are the same.
    """
    setup = assembly.setup(sink, record_hz)
    sink.path(REFERENCE_PATH_TOPIC, 0.0, assembly.reference_path(_PATH_STEP_M))
    stages = tuple(stage for stage in assembly.stages if prepared or stage is not prepare)
    return drive(setup, assembly.ticks, stages, on_tick)


def describe(
    name: str,
    scenario: Scenario,
    seed: int,
    assembly: Assembly,
    sources: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the metadata of a run for log and record; `sources` are as of `user_sources`."""
    return {
        "scenario": name,
        "controller": scenario.controller.name,
        "seed": str(seed),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": "{processor}, {cores} cores, {system}".format(**machine()),
        "mismatch": ", ".join(map(str, assembly.mismatch)) or "none",
        **assembly.frame.metadata,
        **versions(),
        **sources,
    }


def versions_of(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return the versions and the hashes of a user's code in the metadata of a run."""
    others = (*_OF_THE_RUN, SALVAGED_KEY, RECOVERED_KEY)
    return {name: text for name, text in metadata.items() if name not in others}


def open_log(
    file: Path, scenario: Scenario, assembly: Assembly, scenery: Scenery, metadata: dict[str, str]
) -> LogWriter:
    """Return the writer of a run's log, see `LogWriter`; enter it to write."""
    return LogWriter(
        file,
        metadata=metadata,
        attachments={
            "scenario.toml": dump(scenario),
            "vehicle.toml": VEHICLES.find(scenario.plant.vehicle.file).read_text(encoding="utf-8"),
            "model.xml": assembly.plant.mjcf,
            GROUND_FILE: assembly.plant.ground.to_npz(),
        },
        scenery=scenery,
    )


def first_line(metadata: Mapping[str, str]) -> Event:
    """Return the log line of the start of a run."""
    text = (
        f"{BEGINS}{metadata['scenario']}, controller {metadata['controller']}, "
        f"seed {metadata['seed']}, ttempc {metadata['ttempc']}"
    )
    return Event(0.0, "info", text)


def last_line(outcome: Outcome) -> Event:
    """Return the log line that tells how a run ended."""
    end_s = outcome.duration_s
    return Event(end_s, "info", f"{ENDS}{outcome.status} after {end_s:.1f} s")


def _with_controller(
    scenario: Scenario,
    factory: Callable[..., object] | None,
    options: Mapping[str, OptionValue] | None,
) -> tuple[Scenario, dict[str, str]]:
    """Return the scenario as it is filed, and a hash of the source of every part of a user's."""
    if factory is not None:
        settings = replace(scenario.controller, name=name_of(factory), options=dict(options or {}))
        scenario = replace(scenario, controller=settings)
    return scenario, user_sources(scenario, factory)


def _summarise(
    record: Record,
    name: str,
    scenario: Scenario,
    seed: int,
    outcome: Outcome,
    log: str | None,
    sources: Mapping[str, str],
) -> Summary:
    if outcome.traceback:
        print(outcome.traceback, end="", file=sys.stderr)
    code = {**versions(), **sources}
    facts = RunFacts(
        run_id=identity(dump(scenario), seed, code),
        scenario=name,
        controller=scenario.controller.name,
        seed=seed,
        status=outcome.status,
        failure=outcome.failure,
        versions=code,
        log=log,
    )
    return summarise(record, facts, outcome.wall_s)
