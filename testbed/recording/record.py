"""Sinks and record of a run: its channels as tables, its events and its metadata."""

from __future__ import annotations

import math
import mmap
import tempfile
from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, TYPE_CHECKING, Final

import numpy as np

from ttempc.types import FloatArray

from ..errors import LogError
from ..truth import TruthBlock
from .channels import CHANNELS, ERROR, REFERENCE, STATE, Channel, error_rows

if TYPE_CHECKING:
    from pandas import DataFrame

LEARNT: Final = "learnt: "  # beginnings of the texts of events: which parameters were learnt,
FAULT: Final = "fault: "  # that a fault begins or ends,
REACTION: Final = "reaction: "  # how the guidance departs from the controller,
REACTION_ENDED: Final = "reaction ended"
OVERRUN: Final = "overrun: "  # that a step took longer than its period
_KEPT: Final = 1 << 18  # numbers of a channel in memory; more of them go to a file
RESUMED: Final = "resumed by an operator"
IMPORTED_KEY: Final = "imported"  # of the metadata of a foreign record: its file and format
NOT_MEASURED_KEY: Final = "not_measured"  # likewise: sensors whose samples were computed
BEGINS: Final = " begins"
ENDS: Final = " ends"


@dataclass(frozen=True, slots=True)
class Event:
    """One event of a run, as text."""

    time_s: float
    level: str  # "info", "warning" or "error"
    text: str


@dataclass(frozen=True, slots=True, repr=False)
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
            column = self.values[:, self.channel.fields.index(name)]
        except ValueError:
            raise KeyError(f"{self.channel.topic} has no field {name!r}") from None
        if not isinstance(file := self.values.base, mmap.mmap):
            return column
        column = column.copy()
        if hasattr(mmap, "MADV_DONTNEED"):  # not on Windows: pages that were read leave memory
            file.madvise(mmap.MADV_DONTNEED)
        return column

    def columns(self, *names: str) -> FloatArray:
        """Return the named columns side by side, (n, len(names))."""
        return np.column_stack([self[name] for name in names])

    def __len__(self) -> int:
        return len(self.time_s)

    def to_pandas(self) -> DataFrame:
        """Return the rows as a data frame with `time_s` as its index."""
        import pandas  # takes a third of a second, which a run does not need

        index = pandas.Index(self.time_s, name="time_s")
        return pandas.DataFrame(self.values, index, self.channel.fields)

    def __repr__(self) -> str:
        ends = f", {self.time_s[0]:g} to {self.time_s[-1]:g} s" if len(self) else ""
        return f"<{self.channel.topic}: {len(self)} rows{ends}, {len(self.channel.fields)} fields>"


@dataclass(frozen=True, slots=True, repr=False)
class Record:
    """Data of a run: a table per topic, events and metadata."""

    tables: Mapping[str, Table]
    events: Sequence[Event] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, channel: Channel | str) -> Table:
        """Return the table of a channel or of its topic, such as "/state".

        "/error" is computed from "/state" and "/reference", as in the log.

        Raises:
            KeyError: the record has no such topic.
        """
        topic = channel if isinstance(channel, str) else channel.topic
        if topic == ERROR.topic and topic not in self.tables:
            state = self[STATE]
            reference = self[REFERENCE]
            return Table(ERROR, state.time_s, error_rows(state.values, reference.values))
        try:
            return self.tables[topic]
        except KeyError:
            raise KeyError(f"no topic {topic!r}; topics are {', '.join(self.tables)}") from None

    def to_pandas(self) -> dict[str, DataFrame]:
        """Return a data frame for each topic that has rows, see `Table.to_pandas`."""
        return {topic: table.to_pandas() for topic, table in self.tables.items() if len(table)}

    def __repr__(self) -> str:
        run = [self.metadata[key] for key in ("scenario", "controller") if key in self.metadata]
        run += [f"seed {self.metadata['seed']}"] if "seed" in self.metadata else []
        end_s = max((table.time_s[-1] for table in self.tables.values() if len(table)), default=0.0)
        title = ", ".join(["Record", *run, f"{end_s:.1f} s, {len(self.events)} events"])
        topics = (f"{topic} ({len(table)})" for topic, table in self.tables.items() if len(table))
        return f"<{title}: {', '.join(topics)}>"


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


def wrong_shape(channel: Channel, times: FloatArray, values: FloatArray) -> ValueError:
    """Return the error of rows that have not one number per field and a time each."""
    return ValueError(
        f"{channel.topic}: got values of shape {values.shape} at {len(times)} times, "
        f"has {len(channel.fields)} fields"
    )


class Sink:
    """Receiver of the data of a run, each channel in the order of its time; it ignores them.

    Rows and events are the record of the run. Scenes and paths serve viewers only: they repeat
    numbers of the rows. Arrays do not change once they were sent: a sink may keep them.
    """

    draws = False  # whether it has a use for scenes and paths

    def rows(self, channel: Channel, times: FloatArray, values: FloatArray) -> None:
        """Receive rows: times (n,) [s] and one number per field of the channel, (n, fields).

        Raises:
            ValueError: the number of values is not the channel's.
        """

    def row(self, channel: Channel, time_s: float, values: Sequence[float] | FloatArray) -> None:
        """Receive one row, as `rows`."""
        self.rows(channel, np.array([time_s]), np.array([values], dtype=float))

    def event(self, event: Event) -> None:
        """Receive one event."""

    def scenes(self, moments: TruthBlock) -> None:
        """Receive the poses of every body and of both axle points at some moments.

        They come before the rows of the same moments.
        """

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Receive a line of points (n, 2) [m], map frame, to be drawn under a topic.

        A point every 0.2 m is enough.
        """


class Tee(Sink):
    """Sink that passes all data to several sinks, in their order."""

    def __init__(self, *sinks: Sink) -> None:
        self._sinks = sinks
        self.draws = any(sink.draws for sink in sinks)

    def rows(self, channel: Channel, times: FloatArray, values: FloatArray) -> None:
        """Pass on rows."""
        for sink in self._sinks:
            sink.rows(channel, times, values)

    def row(self, channel: Channel, time_s: float, values: Sequence[float] | FloatArray) -> None:
        """Pass on one row."""
        for sink in self._sinks:
            sink.row(channel, time_s, values)

    def event(self, event: Event) -> None:
        """Pass on one event."""
        for sink in self._sinks:
            sink.event(event)

    def scenes(self, moments: TruthBlock) -> None:
        """Pass on scenes."""
        for sink in self._sinks:
            sink.scenes(moments)

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Pass on one path."""
        for sink in self._sinks:
            sink.path(topic, time_s, points)


class _Columns:
    """Times and values of a channel: the latest in memory, those before in temporary files."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._latest = array("d"), array("d")
        self._files: list[IO[bytes]] = []

    def __del__(self) -> None:
        for file in self._files:
            file.close()

    def add(self, times: bytes, values: bytes) -> None:
        """Add rows, doubles each."""
        self._latest[0].frombytes(times)
        self._latest[1].frombytes(values)
        if len(self._latest[1]) > _KEPT:
            self._move()

    def table(self) -> Table:
        """Return the rows so far."""
        width = len(self._channel.fields)
        if not self._files:
            times, values = map(np.array, self._latest)
            return Table(self._channel, times, values.reshape(-1, width))
        self._move()
        times, values = (mmap.mmap(f.fileno(), 0, access=mmap.ACCESS_READ) for f in self._files)
        shape = len(times) // 8, width
        return Table(
            self._channel, np.ndarray(shape[0], buffer=times), np.ndarray(shape, buffer=values)
        )

    def _move(self) -> None:
        try:
            self._files = self._files or [tempfile.TemporaryFile() for _ in self._latest]  # noqa: SIM115
            for file, numbers in zip(self._files, self._latest, strict=True):
                numbers.tofile(file)
                file.flush()
                del numbers[:]
        except OSError as error:
            place = f"{tempfile.gettempdir()}: the record of a long run cannot be written"
            raise LogError(f"{place}: {error.strerror}") from error


class Recorder(Sink):
    """Collector of rows and events; every event is passed to `on_event`.

    Of a long run a channel's rows move to a temporary file without a name: memory does not grow
    with the time driven. Its tables are read-only maps of that file.
    """

    def __init__(
        self,
        channels: Sequence[Channel] = CHANNELS,
        on_event: Callable[[Event], object] | None = None,
    ) -> None:
        self._on_event = on_event or (lambda event: None)
        self._columns = {channel.topic: _Columns(channel) for channel in channels}
        self._events: list[Event] = []

    def rows(self, channel: Channel, times: FloatArray, values: FloatArray) -> None:
        """Add rows."""
        if values.shape != (len(times), len(channel.fields)):
            raise wrong_shape(channel, times, values)
        self._columns[channel.topic].add(times.tobytes(), values.tobytes())

    def row(self, channel: Channel, time_s: float, values: Sequence[float] | FloatArray) -> None:
        """Add one row."""
        if len(values) != len(channel.fields):
            raise wrong_shape(channel, np.empty(1), np.array(values))
        data = np.array(values, dtype=float).tobytes()
        self._columns[channel.topic].add(array("d", [time_s]).tobytes(), data)

    def event(self, event: Event) -> None:
        """Add one event."""
        self._events.append(event)
        self._on_event(event)

    def record(self, metadata: Mapping[str, str] | None = None) -> Record:
        """Return the record of the data collected so far."""
        tables = {topic: columns.table() for topic, columns in self._columns.items()}
        return Record(tables, tuple(self._events), dict(metadata or {}))
