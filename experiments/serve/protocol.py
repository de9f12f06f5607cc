"""Interface of a wire protocol: what a session tells it, and what it makes of datagrams."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from ttempc.reference.reference import Reference
from ttempc.types import Estimate, Measurement
from ttempc.vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Facts of a run that the peer may need before its first tick."""

    scenario: str
    seed: int
    period_s: float  # control period [s]
    ticks: int  # of the reference
    lockstep: bool  # whether the plant waits for every command
    vehicle: Vehicle  # model parameters
    reference: Reference


@dataclass(frozen=True, slots=True)
class TickData:
    """Data of one control tick for the peer."""

    k: int  # control tick
    time_s: float  # [s]
    samples: Sequence[Measurement]  # that arrived since the tick before, as measured
    estimate: Estimate
    reference: Reference  # for the present model parameters
    reference_tick: int  # to which this tick belongs: those that waited apart


@dataclass(frozen=True, slots=True)
class RemoteCommand:
    """Command of the peer; None leaves an input to the plant's own law, see `RemoteController`."""

    tick: int | None  # to which it belongs; None where the protocol does not count
    delta_t: float  # front steering [rad], positive to the left
    delta_i: float | None = None  # trailer steering [rad]
    hp: float | None = None  # hydrostat position, fraction


@dataclass(slots=True)
class CommandLink:
    """Commands of the peer as controller and detector see them; the session writes, they read."""

    protocol: str  # its name, a part of the run's identity
    space_based: bool
    command: RemoteCommand | None = field(default=None, repr=False)  # the latest
    silence_s: float = field(default=0.0, repr=False)  # simulated, since the tick of that command


@dataclass(frozen=True, slots=True)
class Received:
    """Content of a valid datagram."""

    command: RemoteCommand | None = None
    replies: Sequence[bytes] = field(default=())


class WireProtocol(Protocol):
    """Datagrams of one protocol; it has neither socket nor clock."""

    name: str
    space_based: bool  # whether the peer follows a line of its own and not the reference over time

    peer_name: str  # as the peer gives it
    ready: bool  # whether the peer has said that the vehicle may start

    def begin(self, facts: RunFacts) -> None:
        """Take in the facts of the run, before the peer is waited for."""
        ...

    def receive(self, payload: bytes) -> Received:
        """Return the content of a datagram.

        Raises:
            Refused: it is not one of this protocol.
        """
        ...

    def standing(self) -> Sequence[bytes]:
        """Return what is sent every period while the vehicle waits for its start."""
        ...

    def period(self, data: TickData) -> Sequence[bytes]:
        """Return what is sent at a control tick."""
        ...

    def end(self, status: str) -> Sequence[bytes]:
        """Return what is sent when the run has ended."""
        ...
