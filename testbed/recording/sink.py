"""Where the loop says what happened: one interface, and a fan-out to several of its kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ttempc.types import FloatArray

from ..truth import Truth
from .channels import Channel
from .record import Event


class Sink(Protocol):
    """Takes everything that a run has to say, each channel in the order of its time.

    Rows and events are the record of the run. Scenes and paths are there for viewers only: they
    say nothing that the rows do not say, so that a sink without eyes may ignore them.
    """

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Take one row, one number per field of the channel."""
        ...

    def event(self, event: Event) -> None:
        """Take one event."""
        ...

    def scene(self, truth: Truth) -> None:
        """Take the place of every body and of the two axle points at one moment."""
        ...

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Take a line of points (n, 2) [m], map frame, that is to be seen under `topic`.

        A point every 0.2 m is plenty for the eye; the topics are those of `testbed.log.log`.
        """
        ...


class Tee:
    """Hands everything to several sinks, in their order."""

    def __init__(self, *sinks: Sink) -> None:
        self._sinks = sinks

    def row(self, channel: Channel, time_s: float, values: Sequence[float]) -> None:
        """Hand on one row."""
        for sink in self._sinks:
            sink.row(channel, time_s, values)

    def event(self, event: Event) -> None:
        """Hand on one event."""
        for sink in self._sinks:
            sink.event(event)

    def scene(self, truth: Truth) -> None:
        """Hand on one scene."""
        for sink in self._sinks:
            sink.scene(truth)

    def path(self, topic: str, time_s: float, points: FloatArray) -> None:
        """Hand on one path."""
        for sink in self._sinks:
            sink.path(topic, time_s, points)
