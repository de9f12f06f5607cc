"""Sinks: the interface to which the loop writes, and a fan-out to several sinks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from ttempc.types import FloatArray

from ..truth import Truth
from .channels import Channel
from .record import Event


class Sink(Protocol):
    """Receiver of the data of a run, each channel in the order of its time.

    Rows and events are the record of the run. Scenes and paths serve viewers only: they repeat
    numbers of the rows, and a sink may ignore them.
    """

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Receive one row, one number per field of the channel."""
        ...

    def event(self, event: Event) -> None:
        """Receive one event."""
        ...

    def scene(self, truth: Truth) -> None:
        """Receive the poses of every body and of both axle points at one moment."""
        ...

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Receive a line of points (n, 2) [m], map frame, to be drawn under `topic`.

        A point every 0.2 m is enough; the topics are those of `testbed.recording.topics`.
        """
        ...


class Tee:
    """Sink that passes all data to several sinks, in their order."""

    def __init__(self, *sinks: Sink) -> None:
        self._sinks = sinks

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Pass on one row."""
        for sink in self._sinks:
            sink.row(channel, time_s, values)

    def event(self, event: Event) -> None:
        """Pass on one event."""
        for sink in self._sinks:
            sink.event(event)

    def scene(self, truth: Truth) -> None:
        """Pass on one scene."""
        for sink in self._sinks:
            sink.scene(truth)

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Pass on one path."""
        for sink in self._sinks:
            sink.path(topic, time_s, points)


class OnEvent:
    """Sink that calls a function with every event."""

    def __init__(self, call: Callable[[Event], object]) -> None:
        self._call = call

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Ignore a row."""

    def event(self, event: Event) -> None:
        """Pass on one event."""
        self._call(event)

    def scene(self, truth: Truth) -> None:
        """Ignore a scene."""

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Ignore a path."""
