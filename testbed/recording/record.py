"""Record of a run: its channels as tables, its events and its metadata."""

from __future__ import annotations

import math
from array import array
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..truth import Truth
from .channels import CHANNELS, Channel

LEARNT: Final = "learnt: "
"""Beginning of the text of an event that tells which model parameters were learnt."""


FAULT: Final = "fault: "
"""Beginning of the text of an event that tells that a fault begins or ends."""

BEGINS: Final = " begins"
ENDS: Final = " ends"


@dataclass(frozen=True, slots=True)
class Event:
    """One event of a run, as text."""

    time_s: float
    level: str  # "info", "warning" or "error"
    text: str


@dataclass(frozen=True, slots=True)
class Table:
    """All rows of one channel."""

    channel: Channel
    time_s: FloatArray  # (n,)
    values: FloatArray  # (n, len(channel.fields))

    def __getitem__(self, name: str) -> FloatArray:
        """Return the column of the field `name`, (n,).

        Raises:
            KeyError: the channel has no such field.
        """
        try:
            return self.values[:, self.channel.fields.index(name)]
        except ValueError:
            raise KeyError(f"{self.channel.topic} has no field {name!r}") from None

    def columns(self, *names: str) -> FloatArray:
        """Return the named columns side by side, (n, len(names))."""
        return np.column_stack([self[name] for name in names])

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, slots=True)
class Record:
    """Data of a run: a table per topic, events and metadata."""

    tables: Mapping[str, Table]
    events: Sequence[Event] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, channel: Channel) -> Table:
        return self.tables[channel.topic]


@dataclass(frozen=True, slots=True)
class FaultSpan:
    """Time in which a fault acted."""

    name: str
    start_s: float
    end_s: float  # infinite where it did not end before the run


def fault_spans(events: Sequence[Event]) -> tuple[FaultSpan, ...]:
    """Return the times in which faults acted, in the order of their starts."""
    spans = []
    for number, event in enumerate(events):
        if event.text.startswith(FAULT) and event.text.endswith(BEGINS):
            name = event.text.removeprefix(FAULT).removesuffix(BEGINS)
            end = f"{FAULT}{name}{ENDS}"
            times = (later.time_s for later in events[number:] if later.text == end)
            spans.append(FaultSpan(name, event.time_s, next(times, math.inf)))
    return tuple(spans)


class Recorder:
    """Collector of rows and events in memory; a `testbed.recording.sink.Sink`."""

    def __init__(self, channels: Sequence[Channel] = CHANNELS) -> None:
        self._channels = {channel.topic: channel for channel in channels}
        self._times = {topic: array("d") for topic in self._channels}
        self._values = {topic: array("d") for topic in self._channels}
        # of the last `record`, which share its memory
        self._tables = {
            topic: Table(channel, np.empty(0), np.empty((0, len(channel.fields))))
            for topic, channel in self._channels.items()
        }
        self._events: list[Event] = []

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Add one row, one number per field of the channel.

        Raises:
            ValueError: the number of values is not the channel's.
        """
        if len(values) != len(channel.fields):
            raise ValueError(
                f"{channel.topic}: got {len(values)} values, has {len(channel.fields)} fields"
            )
        self._times[channel.topic].append(time_s)
        self._values[channel.topic].extend(values)

    def event(self, event: Event) -> None:
        """Add one event."""
        self._events.append(event)

    def scene(self, truth: Truth) -> None:
        """Ignore a scene: the rows have its numbers."""

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Ignore a path: the rows have its numbers."""

    def record(self, metadata: Mapping[str, str] | None = None) -> Record:
        """Return the record of the data collected so far."""
        for topic, table in self._tables.items():
            times = np.concatenate([table.time_s, self._times.pop(topic)])
            rows = np.reshape(self._values.pop(topic), (-1, len(table.channel.fields)))
            values = np.concatenate([table.values, rows])
            self._tables[topic] = Table(table.channel, times, values)
            self._times[topic], self._values[topic] = array("d"), array("d")
        return Record(dict(self._tables), tuple(self._events), dict(metadata or {}))
