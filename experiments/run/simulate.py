"""A run in memory: scenario and seed -> plant, sensors and guidance -> record -> summary.

`simulate` returns the numbers, `drive_into` drives. Parts: `experiments/run/assembly.py`,
`testbed/simulation/loop.py`, `experiments/results/summary.py`; `run_folder.py` writes a folder.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Final

from ...testbed.recording.channels import REFERENCE_PATH_TOPIC
from ...testbed.recording.provenance import versions
from ...testbed.recording.record import Record, Recorder, Sink, Tee
from ...testbed.simulation.loop import Outcome, drive, prepare
from ..results.summary import RunFacts, Summary, summarise
from ..scenario.scenario import Scenario, dump, identity
from .assembly import Assembly, assemble
from .shared_parts import SharedParts
from .user_code import exits_raise, name_of, user_sources

_PATH_STEP_M: Final = 0.2  # between the points of the reference path in the log


@exits_raise()
def simulate(
    name: str,
    scenario: Scenario,
    seed: int,
    factory: Callable[..., object] | None = None,
    log: Path | None = None,
    *,
    options: Mapping[str, object] | None = None,
    parts: SharedParts | None = None,
) -> tuple[Summary, Record]:
    """Run a scenario in memory and return its numbers; nothing is written but the log, if asked.

    The controller does not prepare its steps: its computation times are those of cold caches.

    Args:
        name, scenario: what to run.
        seed: draws terrain and noise.
        factory: makes a controller of your own from vehicle, reference and control period [s]. The
            run is filed under its name `module:qualname` and a hash of its source.
        options: keyword options of the factory: numbers, text, bool, lists of numbers.
        log: file to write the log to, in a folder that exists.
        parts: of earlier runs, to be used again; none by default.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible.
    """
    scenario, sources = with_controller(scenario, factory, options)
    assembly = assemble(scenario, seed, factory, parts)
    recorder = Recorder()
    if log is None:
        outcome = drive_into(recorder, assembly, prepared=False)
    else:
        # Imported here so that a run without a log does not load the writer.
        from .run_log import describe, first_line, last_line, open_log

        metadata = describe(name, scenario, seed, assembly, sources)
        with open_log(log, scenario, assembly, assembly.scenery, metadata) as writer:
            writer.event(first_line(metadata))
            outcome = drive_into(Tee(recorder, writer), assembly, prepared=False)
            writer.event(last_line(outcome))
    del assembly  # plant and horizons: the summary of a long run takes their memory
    record = recorder.record()
    file = log.name if log else None
    return summarise_run(record, name, scenario, seed, outcome, file, sources), record


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


def with_controller(
    scenario: Scenario,
    factory: Callable[..., object] | None,
    options: Mapping[str, object] | None,
) -> tuple[Scenario, dict[str, str]]:
    """Return the scenario as it is filed, and a hash of the source of every part of a user's."""
    if factory is not None:
        settings = scenario.controller.of_user(name_of(factory), options or {})
        scenario = replace(scenario, controller=settings)
    return scenario, user_sources(scenario, factory)


def summarise_run(
    record: Record,
    name: str,
    scenario: Scenario,
    seed: int,
    outcome: Outcome,
    log: str | None,
    sources: Mapping[str, str],
) -> Summary:
    """Return the summary of a driven run; the traceback of a user's code goes to stderr.

    Args:
        record: of the run.
        name, scenario, seed: of what was driven.
        outcome: of the loop.
        log: name of the run's log; None: none was written.
        sources: hashes of a user's code, as of `user_sources`.
    """
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
