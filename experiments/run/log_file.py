"""Log of a run with its metadata and attachments."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ...testbed.ground.ground import GROUND_FILE
from ...testbed.log.reader import RECOVERED_KEY, SALVAGED_KEY
from ...testbed.log.writer import LogWriter
from ...testbed.messages.scenery import Scenery
from ...testbed.recording.provenance import machine, versions
from ...testbed.recording.record import Event
from ...testbed.simulation.loop import Outcome
from ..scenario.scenario import Scenario, dump
from .assembly import Assembly

SETTINGS: Final = "settings: "
BEGINS: Final = "run begins: "
ENDS: Final = "run ends: "
"""Beginnings of the lines that a log has beside the events of the run's record."""

_NESTED: Final = (dict, list)
_OF_THE_RUN: Final = ("scenario", "controller", "seed", "started", "machine", "mismatch")


def describe(
    name: str,
    scenario: Scenario,
    seed: int,
    assembly: Assembly,
    sources: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the metadata of a run for log and record.

    Args:
        name: of the scenario.
        scenario: resolved.
        seed: of the run.
        assembly: of the run.
        sources: hashes of a user's code, see `user_sources`.
    """
    return {
        "scenario": name,
        "controller": scenario.controller.name,
        "seed": str(seed),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": "{processor}, {cores} cores, {system}".format(**machine()),
        "mismatch": ", ".join(map(str, assembly.mismatch)) or "none",
        **versions(),
        **sources,
    }


def versions_of(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return the versions and the hashes of a user's code in the metadata of a run."""
    others = (*_OF_THE_RUN, SALVAGED_KEY, RECOVERED_KEY)
    return {name: text for name, text in metadata.items() if name not in others}


def open_log(
    file: Path,
    scenario: Scenario,
    assembly: Assembly,
    scenery: Scenery,
    metadata: dict[str, str],
) -> LogWriter:
    """Return the writer of a run's log; enter it to write.

    Raises:
        LogError: as `LogWriter`.
    """
    return LogWriter(
        file,
        metadata=metadata,
        attachments={
            "scenario.toml": dump(scenario),
            "vehicle.toml": scenario.plant.vehicle.file_text(),
            "model.xml": assembly.plant.mjcf,
            GROUND_FILE: assembly.plant.ground.to_npz(),
        },
        scenery=scenery,
    )


def first_lines(metadata: Mapping[str, str], scenario: Scenario) -> tuple[Event, ...]:
    """Return the log lines with the settings of a run, a line for each table, and of its start.

    Tables within tables and arrays are left out; the attachment `scenario.toml` has them all.
    """
    tables = {
        name: [f"{key} = {value}" for key, value in table.items() if not isinstance(value, _NESTED)]
        for name, table in tomllib.loads(dump(scenario)).items()
        if isinstance(table, dict)
    }
    begins = (
        f"{BEGINS}{metadata['scenario']}, controller {metadata['controller']}, "
        f"seed {metadata['seed']}, ttempc {metadata['ttempc']}"
    )
    settings = [f"{SETTINGS}{name}: {', '.join(lines)}" for name, lines in tables.items() if lines]
    return tuple(Event(0.0, "info", text) for text in (*settings, begins))


def last_line(outcome: Outcome) -> Event:
    """Return the log line that tells how a run ended."""
    end_s = outcome.duration_s
    return Event(end_s, "info", f"{ENDS}{outcome.status} after {end_s:.1f} s")
