"""One run, in memory or into a folder."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from tqdm import tqdm

from experiments.assembly import Assembly, assemble
from experiments.errors import OutputExists
from experiments.factory import ControllerFactory
from experiments.metrics import summarise
from experiments.scenario import Scenario, dump, identity
from experiments.settings.vehicle import Difference
from experiments.summary import RunFacts, Summary
from testbed.ground import GROUND_FILE
from testbed.log import REFERENCE_PATH_TOPIC, LogWriter
from testbed.loop import Outcome, drive
from testbed.provenance import versions
from testbed.record import Record, Recorder
from testbed.sink import Sink, Tee

_PATH_STEP_M = 0.2  # between the points of the reference path in the log


@dataclass(frozen=True, slots=True)
class Finished:
    """What a run left."""

    summary: Summary
    record: Record
    files: Mapping[str, Path]  # "log", "summary", "scenario", "report" and each figure
    mismatch: tuple[Difference, ...]  # between the vehicle and what was believed of it
    notes: tuple[str, ...] = ()  # on the path


def simulate(
    name: str,
    scenario: Scenario,
    seed: int,
    factory: ControllerFactory | None = None,
    log: Path | None = None,
) -> tuple[Summary, Record]:
    """Run a scenario in memory and return its numbers; nothing is written but the log, if asked.

    Args:
        name: of the scenario.
        scenario: what to run.
        seed: draws terrain and noise.
        factory: makes a controller of your own from vehicle, reference and control period [s].
        log: file to write the log to, in a folder that exists.

    Raises:
        LogError: the log cannot be written.
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible.
    """
    assembly = assemble(scenario, seed, factory)
    recorder = Recorder()
    if log is None:
        outcome = _drive(assembly, recorder, lambda k: None)
    else:
        with _log_writer(name, scenario, seed, assembly, log) as writer:
            outcome = _drive(assembly, Tee(recorder, writer), lambda k: None)
    record = recorder.record()
    facts = _facts(name, scenario, seed, outcome, log and log.name)
    return summarise(record, facts), record


def run(name: str, scenario: Scenario, seed: int, folder: Path) -> Finished:
    """Run a scenario and write log, summary, resolved scenario, figures and report to `folder`.

    Raises:
        OutputExists: the folder exists already; nothing is written.
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            nothing is written.
    """
    # Here, because matplotlib takes a second to load, and workers that only simulate need none.
    from experiments.figures import draw
    from experiments.report import report

    if folder.exists():
        raise OutputExists(f"output folder {folder}: exists already, give another or remove it")
    assembly = assemble(scenario, seed)
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        raise OutputExists(f"output folder {folder}: cannot be made: {error.strerror}") from None
    resolved = dump(scenario)
    files = {"scenario": folder / "scenario.toml", "log": folder / "log.mcap"}
    files["scenario"].write_text(resolved, encoding="utf-8")
    log = _log_writer(name, scenario, seed, assembly, files["log"])
    recorder = Recorder()
    with log, _progress(assembly.ticks, f"{name}, {scenario.controller.name}, seed {seed}") as bar:
        outcome = _drive(assembly, Tee(recorder, log), lambda k: bar.update())
    record = recorder.record(log.metadata)
    summary = summarise(record, _facts(name, scenario, seed, outcome, files["log"].name))
    files["summary"] = folder / "summary.json"
    files["summary"].write_text(summary.to_json(), encoding="utf-8")
    pictures = draw(record)
    for figure, content in pictures.items():
        files[figure] = folder / f"{figure}.png"
        files[figure].write_bytes(content)
    files["report"] = folder / "report.html"
    page = report(summary, record.events, resolved, pictures, assembly.mismatch)
    files["report"].write_text(page, encoding="utf-8")
    return Finished(summary, record, files, assembly.mismatch, assembly.notes)


def _log_writer(
    name: str, scenario: Scenario, seed: int, assembly: Assembly, file: Path
) -> LogWriter:
    """Return the log of a run, with everything that describes it."""
    metadata = {
        "scenario": name,
        "controller": scenario.controller.name,
        "seed": str(seed),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "mismatch": ", ".join(map(str, assembly.mismatch)) or "none",
        **versions(),
    }
    return LogWriter(
        file,
        metadata=metadata,
        attachments={
            "scenario.toml": dump(scenario),
            "vehicle.toml": scenario.plant.vehicle.text(),
            "model.xml": assembly.plant.mjcf,
            GROUND_FILE: assembly.plant.ground.to_npz(),
        },
        body_names=assembly.plant.body_names,
    )


def _drive(assembly: Assembly, sink: Sink, on_tick: Callable[[int], object]) -> Outcome:
    rig = assembly.rig(sink)
    sink.path(REFERENCE_PATH_TOPIC, 0.0, assembly.reference_path(_PATH_STEP_M))
    return drive(rig, assembly.ticks, on_tick=on_tick)


def _facts(name: str, scenario: Scenario, seed: int, outcome: Outcome, log: str | None) -> RunFacts:
    code = versions()
    return RunFacts(
        run_id=identity(dump(scenario), seed, code),
        scenario=name,
        controller=scenario.controller.name,
        seed=seed,
        status=outcome.status,
        failure=outcome.failure,
        wall_s=outcome.wall_s,
        versions=code,
        log=log,
    )


def _progress(ticks: int, what: str) -> tqdm:
    """Return a bar over control periods; silent where no one is watching."""
    return tqdm(total=ticks, desc=what, unit="tick", disable=not sys.stderr.isatty(), leave=False)
