"""Check of a log for completeness, and its description as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from ...testbed.ground.ground import GROUND_FILE
from ...testbed.log.reader import Content, record_of
from ...testbed.recording.channels import (
    CONTROL,
    ESTIMATE,
    REFERENCE,
    STATE,
    TRANSFORMS_TOPIC,
    TYRES,
)
from ...testbed.recording.record import Record

_CHANNELS: Final = (STATE, REFERENCE, TYRES, ESTIMATE, CONTROL)
_REQUIRED_TOPICS: Final = (*(channel.topic for channel in _CHANNELS), TRANSFORMS_TOPIC)
_ATTACHMENTS: Final = ("scenario.toml", "vehicle.toml", "model.xml", GROUND_FILE)


@dataclass(frozen=True, slots=True)
class LogCheck:
    """Result of one check of a log."""

    name: str
    passed: bool
    detail: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.passed else 'FAIL'}  {self.name:<12} {self.detail}"


def check_log(content: Content) -> list[LogCheck]:
    """Check a log for damage, missing attachments and topics, and gaps in time.

    Raises:
        LogError: the log is of another version of this project.
    """
    record = record_of(content)
    return [
        _check_damage(content),
        _check_attachments(content),
        _check_topics(content),
        *_check_times(content, record),
        _check_state(content, record),
    ]


def _check_damage(content: Content) -> LogCheck:
    if content.salvage is None:
        return LogCheck("whole", True, "all chunks and indices present, all checksums correct")
    return LogCheck("whole", False, f"torn or damaged: {content.salvage}")


def _check_attachments(content: Content) -> LogCheck:
    missing = [name for name in _ATTACHMENTS if name not in content.attachments]
    return LogCheck("attachments", not missing, _missing(missing) or ", ".join(_ATTACHMENTS))


def _check_topics(content: Content) -> LogCheck:
    missing = [topic for topic in _REQUIRED_TOPICS if not content.messages.get(topic)]
    detail = _missing(missing) or f"{len(content.messages)}, fields as in this version"
    return LogCheck("topics", not missing, detail)


def _missing(names: list[str]) -> str:
    return f"nothing on {', '.join(names)}" if names else ""


def _check_times(content: Content, record: Record) -> Iterator[LogCheck]:
    """Check that times never decrease, and that no row of the truth is missing."""
    backwards = [
        topic
        for topic, messages in content.messages.items()
        if np.any(np.diff([message.log_time for message in messages]) < 0)
    ]
    detail = f"runs backwards on {', '.join(backwards)}" if backwards else "never runs backwards"
    yield LogCheck("time", not backwards, detail)
    steps_s = np.diff(record[STATE].time_s)
    period_s, longest_s = (np.median(steps_s), steps_s.max()) if len(steps_s) else (0.0, 0.0)
    regular = bool(longest_s <= 1.5 * period_s)
    detail = f"every {1e3 * period_s:g} ms"
    if not regular:
        detail += f", but once nothing for {1e3 * longest_s:g} ms"
    yield LogCheck("truth", regular, detail)


def _check_state(content: Content, record: Record) -> LogCheck:
    """Check that the truth is that of a run: it starts at 0, goes on, and has finite poses."""
    state = record[STATE]
    written_s = np.array([message.log_time for message in content.messages[STATE.topic]]) / 1e9
    detail = f"{len(state)} rows, finite, with the times of their messages"
    if len(state) < 2 or not np.all(np.diff(state.time_s) > 0.0):
        detail = f"{len(state)} rows, must be two or more of rising time"
    elif not (np.isfinite(state.values).all() and state.time_s[0] == 0.0):
        detail = "must start at 0 s and be finite"
    elif not np.allclose(state.time_s, written_s, rtol=0.0, atol=1e-6):
        detail = "times of rows and messages differ"
    elif not np.any(state.values):
        detail = "all zero"
    else:
        return LogCheck("state", True, detail)
    return LogCheck("state", False, detail)


def log_info(content: Content) -> dict[str, Any]:
    """Return what a log holds, in types of JSON.

    Keys: `log`, `state` ("whole", or what is torn), `run` (its metadata), `duration_s`, `failures`,
    `topics` (name, messages, `per_s` or null, schema) and `events` (`time_s`, level, text).

    Raises:
        LogError: the log is of another version of this project.
    """
    record = record_of(content)
    last_times = [group[-1].log_time for group in content.messages.values() if group]
    end_s = max(last_times, default=0) / 1e9
    return {
        "log": str(content.path),
        "state": "whole" if content.salvage is None else f"torn or damaged: {content.salvage}",
        "run": dict(content.metadata),
        "duration_s": end_s,
        "failures": [event.text for event in record.events if event.level == "error"],
        "topics": [
            {
                "name": topic,
                "messages": len(messages),
                "per_s": (len(messages) - 1) / end_s if len(messages) > 1 and end_s else None,
                "schema": content.topics[topic].schema_name,
            }
            for topic, messages in content.messages.items()
        ],
        "events": [
            {"time_s": event.time_s, "level": event.level, "text": event.text}
            for event in record.events
        ],
    }


def format_log_info(info: Mapping[str, Any]) -> list[str]:
    """Return the result of `log_info` as lines."""
    lines = [f"{'log':<14}{info['log']}, {info['state']}"]
    lines += [f"{key:<14}{value}" for key, value in info["run"].items()]
    lines += [f"{'duration':<14}{info['duration_s']:.2f} s"]
    lines += [f"{'failure':<14}{'; '.join(info['failures']) or 'none'}"]
    lines += ["", f"{'topic':<30}{'messages':>9}{'per s':>8}  schema"]
    for topic in info["topics"]:
        rate = "-" if topic["per_s"] is None else f"{topic['per_s']:.1f}"
        lines.append(f"{topic['name']:<30}{topic['messages']:>9}{rate:>8}  {topic['schema']}")
    if info["events"]:
        lines += ["", "events"]
        lines += [
            f"{event['time_s']:8.2f} s  {event['level']:<8}{event['text']}"
            for event in info["events"]
        ]
    return lines
