"""The log of a run, with all that describes the run put into it."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path

from proving_ground.testbed.ground.ground import GROUND_FILE
from proving_ground.testbed.log.log import LogWriter
from proving_ground.testbed.messages.scenery import Scenery
from proving_ground.testbed.recording.provenance import versions

from ..scenario.scenario import Scenario, dump
from .assembly import Assembly


def describe(name: str, scenario: Scenario, seed: int, assembly: Assembly) -> dict[str, str]:
    """Return what log and record say of a run as a whole."""
    return {
        "scenario": name,
        "controller": scenario.controller.name,
        "seed": str(seed),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "mismatch": ", ".join(map(str, assembly.mismatch)) or "none",
        **versions(),
    }


def open_log(
    file: Path,
    scenario: Scenario,
    assembly: Assembly,
    scenery: Scenery,
    metadata: dict[str, str],
) -> LogWriter:
    """Return the log, ready to be entered and written.

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
