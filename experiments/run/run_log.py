"""Log of a run: what it says of the run besides the channels, and its writer."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ...testbed.geodesy import ORIGIN_KEY
from ...testbed.ground.ground import GROUND_FILE
from ...testbed.log.reader import RECOVERED_KEY, SALVAGED_KEY
from ...testbed.log.writer import LogWriter
from ...testbed.messages.scenery import Scenery
from ...testbed.recording.provenance import machine, versions
from ...testbed.recording.record import Event
from ...testbed.simulation.loop import Outcome
from ...testbed.vehicle.vehicle import vehicle_text
from ..scenario.scenario import Scenario, dump, identity
from .assembly import Assembly

BEGINS: Final = "run begins: "
ENDS: Final = "run ends: "
"""Beginnings of the two lines that a log has beside the events of the run's record."""

RUN_KEY: Final = "run"
"""Metadata: identity of the run, which follows from scenario, seed and versions."""

PARTS_KEY: Final = "attachments"
"""Metadata: names and digests of the attachments."""

_OF_THE_RUN: Final = (
    "scenario",
    "controller",
    "seed",
    "started",
    "machine",
    "mismatch",
    ORIGIN_KEY,
    RUN_KEY,
    PARTS_KEY,
)


def describe(
    name: str,
    scenario: Scenario,
    seed: int,
    assembly: Assembly,
    sources: Mapping[str, str] = MappingProxyType({}),
) -> dict[str, str]:
    """Return the metadata of a run for log and record; `sources` are as of `user_sources`."""
    code = {**versions(), **sources}
    return {
        "scenario": name,
        "controller": scenario.controller.name,
        "seed": str(seed),
        "started": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": "{processor}, {cores} cores, {system}".format(**machine()),
        "mismatch": ", ".join(map(str, assembly.mismatch)) or "none",
        RUN_KEY: identity(dump(scenario), seed, code),
        **assembly.frame.metadata,
        **code,
    }


def versions_of(metadata: Mapping[str, str]) -> dict[str, str]:
    """Return the versions and the hashes of a user's code in the metadata of a run."""
    others = (*_OF_THE_RUN, SALVAGED_KEY, RECOVERED_KEY)
    return {name: text for name, text in metadata.items() if name not in others}


def open_log(
    file: Path, scenario: Scenario, assembly: Assembly, scenery: Scenery, metadata: dict[str, str]
) -> LogWriter:
    """Return the writer of a run's log, see `LogWriter`; enter it to write."""
    texts = {
        "scenario.toml": dump(scenario),
        "vehicle.toml": vehicle_text(scenario.plant.vehicle.file),
        "model.xml": assembly.plant.mjcf,
    }
    attachments = {name: text.encode() for name, text in texts.items()}
    attachments[GROUND_FILE] = assembly.plant.ground.to_npz()
    metadata = {**metadata, PARTS_KEY: parts_of(attachments)}
    return LogWriter(file, metadata=metadata, attachments=attachments, scenery=scenery)


def parts_of(attachments: Mapping[str, bytes]) -> str:
    """Return the names of attachments with their digests, as in the metadata."""
    digests = {name: hashlib.sha256(data).hexdigest()[:16] for name, data in attachments.items()}
    return ", ".join(f"{name} {digest}" for name, digest in sorted(digests.items()))


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
