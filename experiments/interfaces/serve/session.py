"""Session of a peer with a run: its command as controller, exchange of datagrams, pace."""

import math
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Final

from ttempc.detectors.interface import Alarm, Observation, Reaction
from ttempc.guidance.guidance import Guidance
from ttempc.guidance.safety import SafetyLimits
from ttempc.guidance.settings import GuidanceSettings
from ttempc.guidance.supervisor import run_on
from ttempc.reference.path import Projection
from ttempc.reference.reference import Reference
from ttempc.types import Command, Controller, Estimate, Input, State
from ttempc.vehicle import Vehicle

from ....testbed.errors import StageFailed
from ....testbed.recording.record import RESUMED, Event
from ....testbed.simulation.loop import with_stages
from ....testbed.simulation.setup import SimulationSetup, TickContext
from ....testbed.simulation.termination import TerminationLimits
from ....testbed.terminal import one_line
from ...errors import InvalidController, ServeError
from ...run.assembly import Assembly, assemble
from ...run.run_folder import Finished, run
from ...scenario.scenario import Scenario
from .agopengps import AgOpenGpsProtocol, Dialect
from .json_protocol import JsonProtocol
from .link import (
    Address,
    CommandLink,
    Link,
    Refused,
    RemoteCommand,
    RunFacts,
    TickData,
    Trouble,
    WireProtocol,
    text_of,
)

_WAIT_SHARE: Final = 0.8  # of a period, for the command; the rest is the plant's; assumed
_MOST_DATAGRAMS: Final = 1000  # that are read after their time: a flood does not hold the plant
_MOST_LISTENERS: Final = 8  # before one of them drives; assumed
_OWNED_S: Final = 3.0  # of silence on the clock after which another peer may drive; assumed
# Of the periods without a command in time, in which a late one has come from a peer that drives: it
# acts from the next tick on. Assumed.
_LATE_SHARE: Final = 0.5
_ECHO_S: Final = 0.1  # in which a repeated command is no request to repeat the samples; assumed
# A peer that follows a line of its own may be anywhere: limits of supervisor and termination.
_FREE: Final = SafetyLimits(cross_m=math.inf, distance_m=math.inf, yaw=math.inf, jump_m=math.inf)
_FREE_GROUND: Final = {"deviation": math.inf, "stuck_deviation": math.inf}


@dataclass(frozen=True, slots=True)
class SessionSettings:
    """Settings of a session."""

    speed: float = 1.0  # simulated seconds per second of the clock
    lockstep: bool = False  # whether the plant waits for every command and keeps no pace
    wait_s: float = 600.0  # for the start, and in lock-step for each command
    hold_s: float | None = None  # for which the last command is held; None: as the protocol has it


class RemoteController(Controller):
    """Controller that returns the command of a session's peer.

    Where the peer gives no hydrostat position, the speed of the reference is held,

        hp = hp_r + (v_r - v) / K,

    with the reference at the same place (space-based protocols) or time, and K of the model; the
    gain 1 / K is assumed. Where it gives no steering of the trailer, the trailer is towed with its
    steering straight.

    Raises:
        InvalidController: there is no link; such a run needs `ttempc serve`.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        reference: Reference,
        period_s: float,
        link: CommandLink | None = None,
    ) -> None:
        if link is None:
            raise InvalidController("this run was driven over UDP: use ttempc serve")
        self._link = link
        self._gain = 1.0 / vehicle.speed_gain
        self.space_based = link.space_based
        grid = reference.on_grid(period_s)
        if self.space_based:
            grid = reference.on_grid(period_s, beyond=run_on(len(grid.time_s)))
            self._projection = Projection(grid.state[:, : State.PSI_T])
        self._grid = grid

    def step(self, estimate: Estimate, k: int) -> Command:
        """Return the latest command of the peer, before the first one that of the reference."""
        speed = float(estimate.state[State.V])
        if self.space_based:
            k = round(self._projection.place(*estimate.state[: State.PSI_T].tolist()))
        k = min(k, len(self._grid.time_s) - 1)
        command = self._link.command
        if command is None:
            return Command(*self._grid.inputs[k].tolist())
        hp = command.hp
        if hp is None:
            deviation = float(self._grid.state[k, State.V]) - speed
            hp = float(self._grid.inputs[k, Input.HP]) + self._gain * deviation
        delta_i = 0.0 if command.delta_i is None else command.delta_i
        return Command(command.delta_t, delta_i, hp)


class SilenceDetector:
    """Detector of a peer that lets go of the steering, or has no command for `limit` seconds.

    The vehicle stops until the peer has a command again.
    """

    name = "command link"

    def __init__(self, link: CommandLink, limit: float) -> None:
        self._link = link
        self.limit = limit

    @property
    def statistic(self) -> float:
        """Time since the latest command [s], simulated; endless where the peer has let go."""
        return math.inf if self._link.released else self._link.silence_s

    @property
    def residual(self) -> float:
        """The same."""
        return self.statistic

    def observe(self, observation: Observation) -> None:
        """Nothing: the session counts the ticks."""

    def alarm(self) -> Alarm:
        """Return the alarm that stops the vehicle."""
        reason = f"no command over UDP for more than {self.limit:g} s"
        if self._link.released:
            reason = "disengaged over UDP"
        return Alarm(self.name, reason, Reaction.STOP)


class PacedGuidance(Guidance):
    """Guidance of a run on the clock: as on a vehicle, nothing waits for what is learnt."""

    def wait(self) -> None:
        """Nothing; `update` takes what was learnt when it is ready."""


class Session:
    """Exchanges samples and commands with one peer, once a control period.

    At tick k the samples go out, and the command of the tick is waited for until 0.8 of the period
    have passed. Without one the last command is held; one that comes late acts from the next tick
    on. After `hold_s` without any, the supervisor stops the vehicle, and the reference waits, as on
    an alarm of any detector. In lock-step the plant waits instead, so that the run depends on
    scenario, seed and commands alone; a command of an earlier tick is answered with the present
    samples again, by which a peer repairs a lost datagram.

    Ticks begin at multiples of the period on the monotonic clock, divided by the speed. A tick
    that begins late is an overrun; the next ones catch up with a lag below a period, a longer one
    is dropped, so that the peer is never asked for commands faster than that.

    Args:
        name: of the scenario.
        link: socket.
        protocol: of the datagrams.
        settings: of the session.
        say: is told what happens before and beside the run, in lines.
    """

    def __init__(
        self,
        name: str,
        link: Link,
        protocol: WireProtocol,
        settings: SessionSettings,
        say: Callable[[str], None],
    ) -> None:
        self.commands = CommandLink(protocol.name, protocol.space_based)
        self.used = 0  # commands that came in time
        self._name = name
        self._link = link
        self._settings = settings
        self._say = say
        self._protocol = protocol
        protocol.host = link.address[0]
        self._hold_s = protocol.hold_s if settings.hold_s is None else settings.hold_s
        self._tick = 0
        self._latest_tick = -1  # of the latest command
        self._last_driver: Address | None = None  # who drove until it fell silent
        self._open = False  # whether a command of the present tick is in time
        self._due = 0.0  # when the present tick begins, on the monotonic clock [s]
        self._running = False  # whether the run has begun
        self._resume = False  # whether the operator has said so since the last tick
        self._samples: tuple[bytes, ...] = ()  # sent last, and when on the monotonic clock [s]
        self._sent_s = 0.0
        self._ended = False
        self._heard_s = 0.0  # when the peer was last heard, on the monotonic clock [s]

    def assemble(
        self, scenario: Scenario, seed: int, factory: Callable[..., object] | None
    ) -> Assembly:
        """Return the objects of the run with the session's stages, once the peer is ready.

        Raises:
            ServeError: no peer was ready in time.
            ExperimentError, TestbedError, TtempcError: as `experiments.run.assembly.assemble`.
        """
        self._period_s = scenario.control.period_s
        silence = SilenceDetector(self.commands, self._hold_s)
        safety = _FREE if self._protocol.space_based else SafetyLimits()
        kind = Guidance if self._settings.lockstep else PacedGuidance

        def of_session(settings: GuidanceSettings) -> GuidanceSettings:
            """Watch the peer beside the built-in detectors, whatever the scenario chooses."""
            return replace(settings, safety=safety, detect=(silence,))

        assembly = assemble(scenario, seed, factory, kind=kind, adjust=of_session)
        guidance = self._guidance = assembly.guidance
        guidance.warm_up()  # so that the peer is not kept waiting by the compiler
        self._ticks = assembly.ticks
        facts = RunFacts(
            scenario=self._name,
            seed=seed,
            period_s=self._period_s,
            ticks=assembly.ticks,
            step=self._settings.lockstep,
            vehicle=guidance.vehicle,
            origin_deg=assembly.frame.origin_deg,
        )
        self._protocol.begin(facts, guidance.reference)
        self._wait_for_the_peer()
        limits = replace(TerminationLimits.of(assembly.plant.vehicle), **_FREE_GROUND)
        stages = with_stages([("estimate", self._exchange)], assembly.stages)
        pace = () if self._settings.lockstep else (self._pace,)
        return replace(
            assembly,
            stages=(*pace, *stages, self._note),
            termination=limits if self._protocol.space_based else None,
        )

    def end(self, status: str) -> None:
        """Tell the peer that the run has ended, once."""
        if not self._ended:
            self._ended = True
            self._send(self._protocol.end(status))

    def totals(self) -> str:
        """Return what was exchanged and what went wrong as one line."""
        parts = [f"{self._link.sent} datagrams sent", f"{self.used} commands in time"]
        counts = self._link.counts
        parts += [f"{counts[trouble]} {trouble}" for trouble in Trouble if counts[trouble]]
        return "UDP: " + ", ".join(parts)

    def _wait_for_the_peer(self) -> None:
        """Answer until the protocol is ready.

        Raises:
            ServeError: it was not in time.
        """
        end = time.monotonic() + self._settings.wait_s
        while not self._protocol.ready:
            now = time.monotonic()
            if now >= end:
                raise ServeError(f"no peer was ready within {self._settings.wait_s:g} s")
            self._send(self._protocol.standing())
            until = min(end, now + self._period_s)
            self._listen(until, lambda: self._protocol.ready)
        self._running = True
        self._heard_s = time.monotonic()

    def _listen(self, until: float, done: Callable[[], bool]) -> None:
        """Take in datagrams until a time of the monotonic clock [s], or until `done`."""
        count = 0
        while not done() and (count < _MOST_DATAGRAMS or time.monotonic() < until):
            datagram = self._link.receive(until)
            if datagram is None:
                return
            self._take(*datagram)
            count += 1

    def _pace(self, setup: SimulationSetup, tick: TickContext) -> None:
        """Wait for the beginning of a tick on the clock."""
        period = self._period_s / self._settings.speed
        now = time.monotonic()
        self._due = self._due + period if tick.k else now
        if now > self._due:
            self._link.counts[Trouble.OVERRUN] += 1
            if now > self._due + period:
                self._due = now
        self._listen(self._due, lambda: False)

    def _exchange(self, setup: SimulationSetup, tick: TickContext) -> None:
        """Send the samples of a tick and wait for its command.

        Raises:
            StageFailed: none came in lock-step.
        """
        assert tick.estimate is not None
        self._tick = tick.k
        data = TickData(
            k=tick.k,
            time_s=tick.now.time_s,
            samples=tick.measurements,
            estimate=tick.estimate,
            reference=self._guidance.reference,
            reference_tick=self._guidance.reference_tick,
        )
        if tick.k == 0:
            text = f"driven over UDP, protocol {self._protocol.name}, by {self._protocol.peer_name}"
            setup.sink.event(Event(tick.now.time_s, "info", one_line(text)))

        # Send the samples, then wait for the command
        self._samples = tuple(self._protocol.period(data))
        self._send_samples()
        if self._settings.lockstep:
            until = time.monotonic() + self._settings.wait_s
        else:
            until = self._due + _WAIT_SHARE * self._period_s / self._settings.speed
        self._open = True
        self._listen(until, lambda: self._latest_tick == tick.k)
        self._open = False
        if self._resume:
            self._resume = False
            self._guidance.resume()
            setup.sink.event(Event(tick.now.time_s, "info", RESUMED))

        # Whether it came in time
        self.commands.silence_s = (tick.k - self._latest_tick) * self._period_s
        if self._latest_tick == tick.k:
            self.used += 1
            return
        self._link.counts[Trouble.MISSING] += 1
        if self._settings.lockstep:
            raise StageFailed(f"no command for tick {tick.k} within {self._settings.wait_s:g} s")
        self._let_others_drive(setup, tick)

    def _let_others_drive(self, setup: SimulationSetup, tick: TickContext) -> None:
        """End the ownership of a silent peer, unless the user has chosen it; the vehicle stands."""
        link = self._link
        if link.peer is None or link.is_chosen or time.monotonic() < self._heard_s + _OWNED_S:
            return
        text = f"peer {text_of(link.peer)} silent for {_OWNED_S:g} s: another one may drive"
        setup.sink.event(Event(tick.now.time_s, "warning", text))
        self._say(text)
        link.audience = [link.peer]
        self._last_driver = link.peer
        link.peer = None
        self._protocol.lapse()

    def _note(self, setup: SimulationSetup, tick: TickContext) -> None:
        """Log the totals at the end.

        Raises:
            StageFailed: the run would be complete, and nobody drove.
        """
        arrived = setup.guidance.reference_tick >= self._ticks
        if tick.lost or tick.stopped or arrived:
            if arrived and not self._was_driven():
                raise StageFailed(f"no command came in time; {self.totals()}")
            setup.sink.event(Event(tick.now.time_s, "info", self.totals()))
            self.end("lost" if tick.lost else "stopped" if tick.stopped else "completed")

    def _was_driven(self) -> bool:
        """Return whether commands came in time, or late ones in at least half of the periods."""
        counts = self._link.counts
        return self.used > 0 or counts[Trouble.LATE] >= _LATE_SHARE * counts[Trouble.MISSING]

    def _take(self, payload: bytes, address: Address) -> None:
        """Take in a datagram; one that is refused is counted, and said the first time."""
        driver = self._last_driver if self._link.peer is None else self._link.peer
        try:
            received = self._protocol.receive(payload, known=address == driver)
        except Refused as error:
            self._link.counts[Trouble.INVALID] += 1
            if self._link.counts[Trouble.INVALID] == 1:
                self._say(one_line(f"refused, from {text_of(address)}: {error}"))
            return
        if self._link.peer is None:
            self._admit(address, drives=self._protocol.ready or address == driver)
        if self._link.peer == address:
            self._heard_s = time.monotonic()
        self._send(received.replies)
        self._resume |= received.resume and self._running
        if received.released or received.command is not None:
            self.commands.released = received.released
        if received.command is not None and self._running:
            self._keep(received.command)

    def _admit(self, address: Address, *, drives: bool) -> None:
        """Let the sender of a valid datagram drive, or listen until somebody does."""
        link = self._link
        if drives:
            link.peer = address
            self._say(f"peer {text_of(address)}")
            return
        # The latest ones listen: those who are silent lock nobody out.
        others = [one for one in link.audience if one != address]
        link.audience = [*others, address][-_MOST_LISTENERS:]

    def _keep(self, command: RemoteCommand) -> None:
        """Keep a command for its tick, for the next one where it is late."""
        tick = self._tick if command.tick is None else command.tick
        if tick > self._tick:
            self._link.counts[Trouble.INVALID] += 1
        elif tick <= self._latest_tick:
            self._link.counts[Trouble.REPEATED] += 1
            echo = time.monotonic() < self._sent_s + _ECHO_S
            if self._settings.lockstep and self._open and not echo:
                self._send_samples()
        else:
            if tick < self._tick or not self._open:
                self._link.counts[Trouble.LATE] += 1
            self.commands.command = command
            self._latest_tick = tick

    def _send_samples(self) -> None:
        self._send(self._samples)
        self._sent_s = time.monotonic()

    def _send(self, payloads: Iterable[bytes]) -> None:
        for payload in payloads:
            self._link.send(payload)


PROTOCOLS: Final[dict[str, Callable[[], WireProtocol]]] = {
    "json": JsonProtocol,
    "agopengps": AgOpenGpsProtocol,
    "agopenweb": partial(AgOpenGpsProtocol, Dialect.AGOPENWEB),
}


def serve(
    name: str,
    scenario: Scenario,
    seed: int,
    folder: Path,
    link: Link,
    protocol: WireProtocol,
    settings: SessionSettings,
    say: Callable[[str], None],
) -> tuple[Finished, str]:
    """Run a scenario with the controller at the other end of a link; write as `run` does.

    Returns:
        What the run left, and what was exchanged as one line.

    Raises:
        ServeError: no peer was ready in time; nothing is written.
        OutputExists, ExperimentError, TestbedError, TtempcError: as `run`.
    """
    session = Session(name, link, protocol, settings, say)
    factory = partial(RemoteController, link=session.commands)
    try:
        finished = run(name, scenario, seed, folder, factory=factory, make=session.assemble)
        session.end(finished.summary.status)
    finally:
        session.end("interrupted")
    return finished, session.totals()
