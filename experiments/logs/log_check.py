"""What a log says of its run, and whether it is as a log should be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from proving_ground.testbed.ground.ground import GROUND_FILE
from proving_ground.testbed.log.log_content import Content
from proving_ground.testbed.log.log_reader import record_of
from proving_ground.testbed.recording.channels import CONTROL, ESTIMATE, REFERENCE, STATE, TYRES
from proving_ground.testbed.recording.record import Record
from proving_ground.testbed.recording.topics import TRANSFORMS_TOPIC

_REQUIRED: Final = (
    *(each.topic for each in (STATE, REFERENCE, TYRES, ESTIMATE, CONTROL)),
    TRANSFORMS_TOPIC,
)
_ATTACHMENTS: Final = ("scenario.toml", "vehicle.toml", "model.xml", GROUND_FILE)


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    what: str
    good: bool
    detail: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.good else 'FAIL'}  {self.what:<12} {self.detail}"


def check(content: Content) -> list[Finding]:
    """Return what was looked at and found.

    Raises:
        LogError: the log is of another version of this project.
    """
    record = record_of(content)
    return [_whole(content), _attachments(content), _topics(content), *_times(content, record)]


def _whole(content: Content) -> Finding:
    if content.salvage is None:
        return Finding("whole", True, "every chunk and index there, every checksum right")
    return Finding("whole", False, f"torn or damaged: {content.salvage}")


def _attachments(content: Content) -> Finding:
    missing = [name for name in _ATTACHMENTS if name not in content.attachments]
    return Finding("attachments", not missing, _lacks(missing) or ", ".join(_ATTACHMENTS))


def _topics(content: Content) -> Finding:
    missing = [topic for topic in _REQUIRED if not content.messages.get(topic)]
    detail = _lacks(missing) or f"{len(content.messages)}, fields as in this version"
    return Finding("topics", not missing, detail)


def _lacks(missing: list[str]) -> str:
    return f"nothing on {', '.join(missing)}" if missing else ""


def _times(content: Content, record: Record) -> Iterator[Finding]:
    backwards = [
        topic
        for topic, messages in content.messages.items()
        if np.any(np.diff([message.log_time for message in messages]) < 0)
    ]
    yield Finding(
        "time",
        not backwards,
        f"runs backwards on {', '.join(backwards)}" if backwards else "never runs backwards",
    )
    period, largest = gap(record)
    even = largest <= 1.5 * period
    yield Finding(
        "truth",
        even,
        f"every {1e3 * period:g} ms"
        + ("" if even else f", but once nothing for {1e3 * largest:g} ms"),
    )


def gap(record: Record) -> tuple[float, float]:
    """Return the usual and the longest time between two rows of the truth [s]."""
    steps = np.diff(record[STATE].time_s)
    return (float(np.median(steps)), float(steps.max())) if len(steps) else (0.0, 0.0)


def information(content: Content) -> list[str]:
    """Return lines that say what run this is, what the log holds, and what happened.

    Raises:
        LogError: the log is of another version of this project.
    """
    record = record_of(content)
    end_s = max(
        (each[-1].log_time / 1e9 for each in content.messages.values() if each), default=0.0
    )
    state = "whole" if content.salvage is None else f"torn or damaged: {content.salvage}"
    ended = [event.text for event in record.events if event.level == "error"]
    lines = [f"{'log':<14}{content.path}, {state}"]
    lines += [f"{key:<14}{value}" for key, value in content.metadata.items()]
    lines += [f"{'duration':<14}{end_s:.2f} s", f"{'failure':<14}{'; '.join(ended) or 'none'}"]
    lines += ["", f"{'topic':<30}{'messages':>9}{'per s':>8}  schema"]
    for topic, messages in content.messages.items():
        rate = f"{(len(messages) - 1) / end_s:.1f}" if len(messages) > 1 and end_s else "-"
        lines.append(f"{topic:<30}{len(messages):>9}{rate:>8}  {content.schemas[topic].name}")
    if record.events:
        lines += ["", "events"]
        lines += [f"{each.time_s:8.2f} s  {each.level:<8}{each.text}" for each in record.events]
    return lines
