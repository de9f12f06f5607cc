"""Check of a log for completeness, recovery of a torn one, and its description as text."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from ttempc.errors import TtempcError

from ...testbed.atomic_write import atomic_write
from ...testbed.configuration.config_io import parse_toml, validated
from ...testbed.errors import LogError, TestbedError
from ...testbed.ground.ground import GROUND_FILE
from ...testbed.log.reader import RECOVERED_KEY, Content, record_of
from ...testbed.log.scene import MODEL_FILE, attachment, ground_of, model_of, motion_of
from ...testbed.log.writer import begin_log, refuse_existing_log
from ...testbed.recording import channels as ch
from ...testbed.recording.record import IMPORTED_KEY, Record
from ...testbed.vehicle.vehicle import PlantVehicle
from ..errors import ExperimentError
from ..run.run_log import (
    BEGINS,
    ENDS,
    PARTS_KEY,
    RUN_KEY,
    first_line,
    parts_of,
    versions_of,
)
from ..scenario.scenario import ScenarioFile, identity

_SCENARIO = "scenario.toml"
_VEHICLE = "vehicle.toml"
_ATTACHMENTS: Final = (_SCENARIO, _VEHICLE, MODEL_FILE, GROUND_FILE)
_NEEDED: Final = ("scenario", "controller", "seed", "started", "ttempc", RUN_KEY, PARTS_KEY)
_MOST_APART_S: Final = 2.0  # a few control periods; assumed
_TOGETHER: Final = (  # topics whose messages are written at the same times
    (ch.STATE.topic, ch.REFERENCE.topic, ch.TYRES.topic, ch.TRANSFORMS_TOPIC),
    (ch.ESTIMATE.topic, ch.CONTROL.topic),
)


@dataclass(frozen=True, slots=True)
class LogCheck:
    """Result of one check of a log."""

    name: str
    passed: bool
    detail: str

    def __str__(self) -> str:
        return f"{'ok  ' if self.passed else 'FAIL'}  {self.name:<12} {self.detail}"


def check_log(content: Content) -> list[LogCheck]:
    """Check a log for damage, missing or foreign attachments and topics, and gaps in time.

    Raises:
        LogError: the log is of another version of this project.
    """
    record = record_of(content)
    files = [name for name in _ATTACHMENTS if name not in content.attachments]
    topics = [topic for group in _TOGETHER for topic in group if not content.messages.get(topic)]
    times = {topic: [each.log_time for each in group] for topic, group in content.messages.items()}
    backwards = [topic for topic, each in times.items() if np.any(np.diff(each) < 0)]
    return [
        LogCheck("whole", not content.salvage, state_of(content)),
        LogCheck("attachments", not files, f"missing: {', '.join(files) or 'none'}"),
        _as_declared(content),
        _of_one_run(content),
        _begins_and_ends(content, record),
        _readable(content),
        _together(times),
        LogCheck("topics", not topics, f"nothing on: {', '.join(topics) or 'none'}"),
        LogCheck("time", not backwards, f"backwards on {', '.join(backwards) or 'none'}"),
        *_truth(record, times),
    ]


def _truth(record: Record, times: Mapping[str, Sequence[int]]) -> tuple[LogCheck, LogCheck]:
    """Check the rows of the true state: without gaps, finite, at the times of their messages."""
    state = record[ch.STATE]
    steps_s = np.diff(state.time_s) if len(state) > 1 else np.zeros(1)
    period_s = float(np.median(steps_s))
    longest_s = float(steps_s.max())
    finite = bool(np.isfinite(state.values).all() and np.any(state.values))
    begins = bool(steps_s.min() > 0.0 and state.time_s[0] == 0.0)
    written = (
        (record[each].time_s, 1e-9 * np.array(times.get(each.topic, []))) for each in ch.CHANNELS
    )
    stamped = all(np.allclose(*pair, rtol=0.0, atol=1e-6) for pair in written)
    return (
        LogCheck(
            "truth",
            longest_s <= 1.5 * period_s,
            f"every {1e3 * period_s:g} ms, once nothing for {1e3 * longest_s:g} ms",
        ),
        LogCheck(
            "state",
            finite and begins and stamped,
            f"{len(state)} rows, to rise from 0 s, finite; all rows at the times of their messages",
        ),
    )


def _readable(content: Content) -> LogCheck:
    """Check that attachments and poses are what their readers expect; no code is run."""
    try:
        scenario, vehicle = (
            parse_toml(attachment(content, name).decode(errors="replace"), LogError, name)
            for name in (_SCENARIO, _VEHICLE)
        )
        if not scenario:
            raise LogError(f"{_SCENARIO}: is empty")
        ScenarioFile(Path(_SCENARIO), scenario).scenario()
        validated(PlantVehicle, vehicle, LogError)
        for read in (model_of, ground_of, motion_of):
            read(content)
    except (ExperimentError, TestbedError, TtempcError) as error:
        return LogCheck("content", False, str(error))
    return LogCheck("content", True, "attachments and poses as this program writes them")


def _as_declared(content: Content) -> LogCheck:
    """Check that the metadata are those of a run, and the attachments those that they list."""
    metadata = content.metadata
    if IMPORTED_KEY in metadata:
        return LogCheck("parts", True, "imported: the record of another program")
    missing = [key for key in _NEEDED if not metadata.get(key)]
    if missing:
        return LogCheck("parts", False, f"metadata without {', '.join(missing)}")
    listed = {*metadata[PARTS_KEY].split(", ")}
    found = {*parts_of(content.attachments).split(", ")}
    others = sorted({part.partition(" ")[0] for part in listed ^ found})
    return LogCheck("parts", not others, f"not as the run left them: {', '.join(others) or 'none'}")


def _of_one_run(content: Content) -> LogCheck:
    """Check that scenario, seed and versions are those from which the run has its identity."""
    metadata = content.metadata
    if IMPORTED_KEY in metadata or RUN_KEY not in metadata:
        return LogCheck("run", IMPORTED_KEY in metadata, "no identity of a run")
    scenario = content.attachments.get(_SCENARIO, b"").decode(errors="replace")
    run = identity(scenario, metadata.get("seed", ""), versions_of(metadata))
    known = run == metadata[RUN_KEY]
    return LogCheck("run", known, f"scenario, seed and versions give {run}: {metadata[RUN_KEY]}")


def _begins_and_ends(content: Content, record: Record) -> LogCheck:
    """Check the lines with which the events of a run begin and end, and the time of the end.

    An imported log has neither; a recovered one may have no end.
    """
    metadata = content.metadata
    if IMPORTED_KEY in metadata:
        return LogCheck("lines", True, "imported: no lines of begin and end")
    begins = [event.text for event in record.events if event.text.startswith(BEGINS)]
    ends = [event.time_s for event in record.events if event.text.startswith(ENDS)]
    if not {"scenario", "controller", "seed", "ttempc"} <= metadata.keys():
        return LogCheck("lines", False, "no metadata to compare them with")
    if begins != [first_line(metadata).text]:
        return LogCheck("lines", False, "begins as another run, twice or not at all")
    if RECOVERED_KEY in metadata and not ends:
        return LogCheck("lines", True, "recovered: no line of the end")
    state_s = record[ch.STATE].time_s
    last_s = float(state_s[-1]) if len(state_s) else 0.0
    whole = len(ends) == 1 and abs(ends[0] - last_s) <= _MOST_APART_S
    said = f"at {ends[0]:.1f} s" if ends else "not at all"
    return LogCheck("lines", whole, f"ends {said}, last state at {last_s:.1f} s")


def _together(times: Mapping[str, list[int]]) -> LogCheck:
    """Check that topics of one stage have messages at the same times, and all the same end."""
    # A torn log may end between two topics.
    ends = [each[-1] for topics in _TOGETHER for topic in topics if (each := times.get(topic))]
    apart_s = 1e-9 * (max(ends, default=0) - min(ends, default=0))
    differing = [
        topic
        for first, *others in _TOGETHER
        for topic in others
        if any(a != b for a, b in zip(times.get(topic, []), times.get(first, []), strict=False))
    ]
    detail = f"other times on {', '.join(differing) or 'none'}; ends {apart_s:.2f} s apart"
    return LogCheck("together", not differing and apart_s <= _MOST_APART_S, detail)


def state_of(content: Content) -> str:
    """Return "whole", or what is torn or damaged."""
    return f"torn or damaged: {content.salvage}" if content.salvage else "whole"


def recover(content: Content, file: Path) -> None:
    """Write the content of a log to a new log, its messages byte for byte.

    Raises:
        LogError: the file or its partial file exists, or it cannot be written; no new file is left.
    """
    refuse_existing_log(file)
    extent = {RECOVERED_KEY: content.salvage} if content.salvage else {}
    try:
        with atomic_write(file) as stream:
            metadata = {**content.metadata, **extent}
            topics = content.topics.values()
            log, numbers = begin_log(stream, metadata, content.attachments, topics)
            for name, number in numbers.items():
                for message in content.messages.get(name, []):
                    data = np.frombuffer(message.data, np.uint8)
                    log.add(number, np.array([message.log_time]), data[None])
            log.finish()
    except OSError as error:
        raise LogError(f"{file}: cannot be written: {error.strerror}") from error


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
        "state": state_of(content),
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
