"""A run that leaves a folder: log, summary and resolved scenario.

The page and its figures are drawn afterwards, see `experiments/pictures/report/run_page.py`: a run
knows no pictures.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ...testbed.log import LOG_NAME
from ...testbed.messages.scenery import Scenery
from ...testbed.recording.record import Event, Record, Recorder, Tee
from ..output import make_folder, progress, refuse_existing, write_file
from ..results.summary import Summary
from ..scenario.plant import record_steps
from ..scenario.scenario import Scenario, dump
from ..scenario.vehicle import ParameterMismatch
from .assembly import Assembly, assemble
from .run_log import describe, first_line, last_line, open_log
from .simulate import drive_into, summarise_run, with_controller
from .user_code import exits_raise

if TYPE_CHECKING:
    from ...testbed.viewers.live import LiveView


@dataclass(frozen=True, slots=True)
class Finished:
    """What a run left."""

    folder: Path
    summary: Summary
    record: Record
    files: Mapping[str, Path]  # "log", "summary", "scenario"; later "report" and each figure
    mismatch: tuple[ParameterMismatch, ...]  # between plant and model
    notes: tuple[str, ...] = ()  # on path and tube
    description: str = ""  # description of the scenario


@dataclass(frozen=True, slots=True, kw_only=True)
class Recording:
    """How a run is recorded and watched."""

    record_hz: float | None = None
    """How often the truth is written down [Hz]; None: as in `record_rate`."""
    watch: Callable[[Scenery], LiveView] | None = None
    """Opens a live view of the run; it gets the same data as the log."""
    on_event: Callable[[Event], object] | None = None
    """Called with every event when it occurs."""
    shown: bool | None = None
    """Whether to show progress, see `output.progress`."""


@exits_raise()
def run(
    name: str,
    scenario: Scenario,
    seed: int,
    folder: Path,
    *,
    factory: Callable[..., object] | None = None,
    options: Mapping[str, object] | None = None,
    make: Callable[[Scenario, int, Callable[..., object] | None], Assembly] = assemble,
    recording: Recording = Recording(),
) -> Finished:
    """Run a scenario and write log, summary and resolved scenario to `folder`.

    Args:
        name, scenario: what to run.
        seed: draws terrain and noise.
        folder: to make.
        factory, options: as in `simulate`.
        make: makes the objects of the run from scenario, seed and factory.
        recording: how the run is recorded and watched.

    Raises:
        OutputExists: the folder exists already; nothing is written.
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            nothing is written.
    """
    refuse_existing(folder)
    scenario, sources = with_controller(scenario, factory, options)
    assembly = make(scenario, seed, factory)
    if recording.record_hz is not None:  # refused here, before anything is written
        period_s = assembly.guidance.period_s
        record_steps(assembly.plant.timestep_s, period_s, recording.record_hz)

    scenery = assembly.scenery
    recorder = Recorder(on_event=recording.on_event)
    metadata = describe(name, scenario, seed, assembly, sources)
    files = {"scenario": folder / "scenario.toml", "log": folder / LOG_NAME}
    with ExitStack() as stack:
        views = [stack.enter_context(recording.watch(scenery))] if recording.watch else []
        make_folder(folder)
        write_file(files["scenario"], dump(scenario))
        log = stack.enter_context(open_log(files["log"], scenario, assembly, scenery, metadata))
        what = f"{name}, {scenario.controller.name}, seed {seed}"
        count = stack.enter_context(progress(assembly.ticks, what, "tick", recording.shown))

        viewers = Tee(log, *views)  # they learn of the run's start and end
        viewers.event(first_line(metadata))
        sink = Tee(recorder, viewers)
        outcome = drive_into(sink, assembly, recording.record_hz, lambda k: count())
        viewers.event(last_line(outcome))

    mismatch = assembly.mismatch
    notes = assembly.notes
    del assembly  # plant and horizons: the record of a long run takes their memory
    record = recorder.record(metadata)
    summary = summarise_run(record, name, scenario, seed, outcome, files["log"].name, sources)
    files["summary"] = folder / "summary.json"
    write_file(files["summary"], summary.to_json())
    return Finished(folder, summary, record, files, mismatch, notes, scenario.description)
