"""Faults between a command and the servos: the bus, the steering valves, the hydrostat."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Final, Literal, NamedTuple

from pydantic.dataclasses import dataclass

from ttempc.types import Command

from ..actuation.actuators import past_play
from ..configuration.config_io import STRICT, Positive
from ..vehicle.vehicle_parts import Steering
from .fault import FaultContext, LastingFault, Window

_SAME_TIME_S: Final = 1e-9  # times closer than this are the same
_AXES: Final = {"front": 0, "trailer": 1, "hydrostat": 2}


class BusState(NamedTuple):
    """Commands on their way to the valves."""

    arrived: Command  # that reaches the valves
    under_way: tuple[tuple[float, Command], ...] = ()  # times of arrival [s] and later commands


@dataclass(frozen=True, kw_only=True, config=STRICT)
class BusFault(LastingFault):
    """A fault of the commands on their way to the valves."""

    @abstractmethod
    def pass_on(self, bus: BusState, command: Command, now_s: float) -> BusState:
        """Return the state of the bus after one physics step.

        Args:
            bus: before the step; at the first step of the fault, with the last command before.
            command: command that is sent.
            now_s: time [s].
        """

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act: no command is sent while it lasts."""
        if not window.holds_multiple(context.period_s):
            return "no command is sent while it lasts"
        return ""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class CommandsLost(BusFault):
    """Commands do not arrive; the last one before holds."""

    kind: Literal["commands_lost"] = "commands_lost"
    """Kind of fault."""

    def pass_on(self, bus: BusState, command: Command, now_s: float) -> BusState:
        """Return the bus as it is."""
        return bus


@dataclass(frozen=True, kw_only=True, config=STRICT)
class CommandsLate(BusFault):
    """Commands arrive late, as after a missed deadline; those under way at the end are lost."""

    kind: Literal["commands_late"] = "commands_late"
    """Kind of fault."""
    delay_s: Positive
    """Further time from tick to valve."""

    def pass_on(self, bus: BusState, command: Command, now_s: float) -> BusState:
        """Return the bus with the new command, and without what has arrived."""
        arrived, under_way = bus
        newest = under_way[-1][1] if under_way else arrived
        if command != newest:
            under_way = (*under_way, (now_s + self.delay_s, command))
        while under_way and under_way[0][0] <= now_s + _SAME_TIME_S:
            arrived, under_way = under_way[0][1], under_way[1:]
        return BusState(arrived, under_way)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ValveFault(LastingFault):
    """A fault of one valve: of the set point of its servo."""

    @property
    def axis(self) -> int:
        """Number of the valve: front steering, trailer steering, hydrostat."""
        return _AXES[self.kind.split("_")[0]]

    @abstractmethod
    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return the set point after one physics step.

        Args:
            memory: set point of the step before; at the first step the present angle [rad], or
                position of the hydrostat.
            target: set point without the fault.
            timestep: physics step [s].
            stop: largest angle [rad], or position.
        """

    def steering(self, context: FaultContext) -> Steering:
        """Return the parameters of the steering axis."""
        vehicle = context.vehicle
        return (vehicle.front_steering, vehicle.trailer_steering)[self.axis]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ValveStuck(ValveFault):
    """A valve is closed: the axis stays where it is."""

    kind: Literal["front_steering_stuck", "trailer_steering_stuck", "hydrostat_stuck"] = (
        "front_steering_stuck"
    )
    """Kind of fault."""

    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return the set point of the step before."""
        return memory


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ValveSlow(ValveFault):
    """A steering valve gives less oil: the angle changes at a lower rate."""

    kind: Literal["front_steering_slow", "trailer_steering_slow"] = "front_steering_slow"
    """Kind of fault."""
    rate_degps: Positive
    """Largest rate; below that of the vehicle."""

    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return the set point, limited in rate."""
        most = math.radians(self.rate_degps) * timestep
        return memory + min(max(target - memory, -most), most)

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        rate = self.steering(context).rate_degps
        if self.rate_degps >= rate:
            return f"got rate_degps {self.rate_degps:g}, must be below that of the valve, {rate:g}"
        return ""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ValveHardOver(ValveFault):
    """A steering valve is fully open to one side: the axis runs to its stop."""

    kind: Literal["front_steering_hard_over", "trailer_steering_hard_over"] = (
        "front_steering_hard_over"
    )
    """Kind of fault."""
    side: Literal["left", "right"]
    """Sign of the angle at the stop: left is positive."""

    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return the stop."""
        return stop if self.side == "left" else -stop


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ValvePlay(ValveFault):
    """A steering linkage is worn: the wheel follows its cylinder with play."""

    kind: Literal["front_steering_play", "trailer_steering_play"] = "front_steering_play"
    """Kind of fault."""
    play_deg: Positive
    """Whole play."""

    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return the set point behind the play."""
        return past_play(memory, target, math.radians(self.play_deg))

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act."""
        stop = self.steering(context).limit_deg
        if self.play_deg >= stop:
            return f"got play_deg {self.play_deg:g}, must be below the stop at {stop:g}"
        return ""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class HydrostatCut(ValveFault):
    """The position of the hydrostat falls to 0, whatever is commanded."""

    kind: Literal["hydrostat_cut"] = "hydrostat_cut"
    """Kind of fault."""

    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return 0."""
        return 0.0


@dataclass(frozen=True, kw_only=True, config=STRICT)
class HydrostatSluggish(ValveFault):
    """The hydrostat follows its command through a further first-order lag."""

    kind: Literal["hydrostat_sluggish"] = "hydrostat_sluggish"
    """Kind of fault."""
    time_constant_s: Positive
    """Time constant of the lag."""

    def move(self, memory: float, target: float, timestep: float, stop: float) -> float:
        """Return the set point behind the lag, exact for a constant target."""
        return target + (memory - target) * math.exp(-timestep / self.time_constant_s)
