"""Link of a run with its peer: data of a tick, interface of a protocol, UDP socket, addresses."""

import ipaddress
import socket
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final, NamedTuple, Self

from ttempc.reference.reference import Reference
from ttempc.types import Estimate, Measurement
from ttempc.vehicle import Vehicle

from ...errors import BadOptions, ServeError

Address = tuple[str, int]
"""IPv4 address and port."""

_MOST_BYTES: Final = 65535  # of a datagram; longer ones do not exist
_SHORTEST_WAIT_S: Final = 1e-4  # a timeout of 0 would make the socket non-blocking


class Trouble(StrEnum):
    """What can go wrong on the link, in the words of log and report."""

    MISSING = "periods without a command in time"
    LATE = "late commands"
    REPEATED = "repeated commands"
    STRANGER = "datagrams from other addresses"
    INVALID = "invalid datagrams"
    UNSENT = "datagrams that could not be sent"
    OVERRUN = "overruns of the clock"


class Refused(Exception):
    """A datagram that its protocol refuses: what was received and what is allowed."""


@dataclass(frozen=True, slots=True)
class RunFacts:
    """Facts of a run that the peer may need before its first tick, by the keys of the welcome."""

    scenario: str
    seed: int
    period_s: float  # control period [s]
    ticks: int  # of the reference
    step: bool  # whether the plant waits for every command
    vehicle: Vehicle  # model parameters
    origin_deg: tuple[float, float]  # latitude and longitude of the map's origin


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
    released: bool = field(default=False, repr=False)  # whether the peer let go after it


class Received(NamedTuple):
    """Content of a valid datagram."""

    command: RemoteCommand | None = None
    replies: Sequence[bytes] = ()
    resume: bool = False  # whether the operator lets a stopped vehicle drive on
    released: bool = False  # whether the peer has let go of the steering


class WireProtocol:
    """Datagrams of one protocol; it has neither socket nor clock."""

    name: str
    space_based = False  # whether the peer follows a line of its own and not the reference
    peer_name = ""  # as the peer gives it
    ready = False  # whether the peer has said that the vehicle may start
    host = "127.0.0.1"  # on which the session listens
    hold_s = 1.0  # simulated time for which the last command is held, where none is asked for
    defaults: Sequence[str] = ()  # overrides of a scenario, before those that are asked for

    def begin(self, facts: RunFacts, reference: Reference) -> None:
        """Take in the facts of the run, before the peer is waited for."""

    def receive(self, payload: bytes, *, known: bool = False) -> Received:
        """Return the content of a datagram.

        Args:
            payload: of the datagram.
            known: whether its sender drives, or drove last: it has said before that it is ready.

        Raises:
            Refused: it is not one of this protocol.
        """
        raise NotImplementedError

    def standing(self) -> Sequence[bytes]:
        """Return what is sent every period while the vehicle waits for its start."""
        return ()

    def period(self, data: TickData) -> Sequence[bytes]:
        """Return what is sent at a control tick."""
        raise NotImplementedError

    def lapse(self) -> None:
        """Forget that a peer was ready, since it fell silent: another one may say so."""
        self.ready = False

    def end(self, status: str) -> Sequence[bytes]:
        """Return what is sent when the run has ended."""
        return ()


class Link:
    """Socket bound to one address, and the peer that owns the session.

    Datagrams have neither password nor encryption: an address that is not of this machine lets
    every computer that reaches it open the session, unless `peer` names the one that may.

    Args:
        address: to bind to; port 0 for any free one.
        peer: the only address that is listened to; None: the first that drives, see `Session`.

    Raises:
        ServeError: the address is not of this machine, or its port is taken.
    """

    def __init__(self, address: Address, peer: Address | None = None) -> None:
        self.peer = peer
        self.is_chosen = peer is not None  # by the user: nobody else ever is the peer
        self.audience: list[Address] = []  # who is answered while nobody owns the session
        self.counts: Counter[Trouble] = Counter()
        self.sent = 0
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise ServeError(f"{text_of(address)} cannot be opened: {error.strerror}") from None
        self.address: Address = self._socket.getsockname()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._socket.close()

    def send(self, payload: bytes) -> None:
        """Send a datagram to peer or audience; one that the system refuses is counted."""
        for address in self.audience if self.peer is None else (self.peer,):
            try:
                self._socket.sendto(payload, address)
            except OSError:  # too long, no route, a full queue
                self.counts[Trouble.UNSENT] += 1
            else:
                self.sent += 1

    def receive(self, until: float) -> tuple[bytes, Address] | None:
        """Return payload and address of the next datagram of the peer, or of anyone while there is
        none; None where none came until a time of the monotonic clock [s].
        """
        while True:
            self._socket.settimeout(max(until - time.monotonic(), _SHORTEST_WAIT_S))
            try:
                payload, address = self._socket.recvfrom(_MOST_BYTES)
            except TimeoutError:
                return None
            except ConnectionError:  # of an earlier datagram that nobody took
                continue
            if self.peer in (None, address):
                return payload, address
            self.counts[Trouble.STRANGER] += 1
            if time.monotonic() > until:  # a flood of strangers does not hold the plant
                return None


def is_local(address: Address) -> bool:
    """Whether only this machine reaches an address."""
    return ipaddress.IPv4Address(address[0]).is_loopback


def address_of(host: str, port: int, option: str) -> Address:
    """Return the IPv4 address of a host, given by address or by name.

    Raises:
        BadOptions: there is none.
    """
    try:
        return socket.gethostbyname(host), port
    except (OSError, UnicodeError):
        raise BadOptions(f"{option}: got {host!r}, must be an IPv4 address or its name") from None


def peer_of(text: str) -> Address:
    """Return the address of HOST:PORT.

    Raises:
        BadOptions: the text is of another form.
    """
    host, colon, port = text.rpartition(":")
    if not (colon and host and port.isdecimal() and 0 < int(port) < 2**16):
        raise BadOptions(f"--peer: got {text!r}, must be HOST:PORT, port from 1 to 65535")
    return address_of(host, int(port), "--peer")


def text_of(address: Address) -> str:
    """Return an address as HOST:PORT."""
    return f"{address[0]}:{address[1]}"
