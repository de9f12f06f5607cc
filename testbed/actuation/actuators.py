"""Command path of the actuators: dead time, dead band, backlash and resolution.

    command -> resolution -> dead time -> dead band -> play -> set point of the servo

The servos in `mjcf/` add rate limits, lags and stops behind it. Every effect is off by default.
States are data: a step takes a state and returns the next one. It runs once a physics step,
because a dead time may end between two control ticks and the dead band depends on the present
angle.

The steering angle of the sensors and of `Truth` is that of the wheel, behind the play: it differs
from the angle of the cylinder by up to half the play. Friction holds the wheel while the cylinder
crosses the play; the crossing itself takes no time.
"""

import math
from typing import Annotated, Any, Final, NamedTuple, Protocol

from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import Command
from ttempc.vehicle import MAX_DEAD_TIME_S

from ..configuration.config_io import STRICT, NotNegative
from ..discretisation import delay_steps, quantised
from ..errors import InvalidPlant

_ROUNDING: Final = 1e-12  # [rad] a set point at the edge of the dead band is inside it

DeadTime = Annotated[float, Field(ge=0, le=MAX_DEAD_TIME_S)]


@dataclass(frozen=True, config=STRICT)
class SteeringValve:
    """Valve and linkage of one steering axis; an effect is off where its value is 0."""

    dead_time_s: DeadTime = 0.0
    """Time from command to valve: bus, solenoid and spool."""
    dead_band_deg: NotNegative = 0.0
    """Half width of the overlap: smaller errors of the angle do not open the valve."""
    backlash_deg: NotNegative = 0.0
    """Whole play between cylinder and wheel."""
    resolution_deg: NotNegative = 0.0
    """Resolution of the command as it is sent."""


@dataclass(frozen=True, config=STRICT)
class HydrostatValve:
    """Valve of the hydrostat; its lag and rate limit belong to the vehicle."""

    dead_time_s: DeadTime = 0.0
    """Time from command to valve."""


@dataclass(frozen=True, config=STRICT)
class ActuatorSpecification:
    """Command path of all actuators."""

    front: SteeringValve = SteeringValve()
    """Steering of the tractor's front wheels."""
    trailer: SteeringValve = SteeringValve()
    """Steering of the trailer's wheels."""
    hydrostat: HydrostatValve = HydrostatValve()
    """Drive."""


# Named tuples: made three times a physics step, they cost a third of a frozen dataclass.
class AxisState(NamedTuple):
    """State of one axis; angles [rad], for the hydrostat positions [-1, 1]."""

    under_way: tuple[tuple[int, float], ...]  # commands in the dead time: step of arrival, value
    arrived: float  # newest command behind the dead time
    cylinder: float  # angle to which the valve moves the cylinder
    set_point: float  # angle to which the cylinder moves the wheel


class ActuatorState(NamedTuple):
    """State of the command path."""

    step: int  # physics steps since the start
    front: AxisState
    trailer: AxisState
    hydrostat: AxisState

    @property
    def set_points(self) -> tuple[float, float, float]:
        """Set points of the servos: front and trailer angle [rad], position of the hydrostat."""
        return self.front.set_point, self.trailer.set_point, self.hydrostat.set_point


class _Axis(NamedTuple):
    delay: int  # physics steps
    dead_band: float = 0.0  # [rad] half width
    backlash: float = 0.0  # [rad] whole play
    resolution: float = 0.0  # [rad]


class CommandPath(Protocol):
    """Way from a command to the set points, with or without faults; its state is its own."""

    @property
    def passive(self) -> bool:
        """Whether every command is a set point at once."""
        ...

    def start(self, hp: float) -> Any:  # noqa: ANN401 - a state of its own
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""

    def step(self, state: Any, command: Command, delta_t: float, delta_i: float) -> Any:  # noqa: ANN401
        """Return the state after one physics step; the arguments are the present angles [rad]."""


class Actuators:
    """The command path of a vehicle.

    Args:
        specification: effects of each axis.
        timestep: physics step [s]; every dead time must be a whole number of steps.
        stops: front and trailer steering angle at the stops [rad].

    Raises:
        InvalidPlant: a dead time is not a whole number of steps, or a dead band, backlash or
            resolution is not below the stop, so that the axis could not be steered at all.
    """

    def __init__(
        self, specification: ActuatorSpecification, timestep: float, stops: tuple[float, float]
    ) -> None:
        self.specification = specification
        self.passive = (
            specification == ActuatorSpecification()
        )  # every command is a set point at once
        self._front = _steering_axis("front", specification.front, timestep, stops[0])
        self._trailer = _steering_axis("trailer", specification.trailer, timestep, stops[1])
        self._hydrostat = _Axis(_delay("hydrostat", specification.hydrostat, timestep))

    def start(self, hp: float) -> ActuatorState:
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""
        straight, rolling = (AxisState((), value, value, value) for value in (0.0, hp))
        return ActuatorState(0, straight, straight, rolling)

    def step(
        self, state: ActuatorState, command: Command, delta_t: float, delta_i: float
    ) -> ActuatorState:
        """Return the state after one physics step; the arguments are the present angles [rad]."""
        now = state.step
        return ActuatorState(
            now + 1,
            _axis_step(state.front, now, command.delta_t, delta_t, self._front),
            _axis_step(state.trailer, now, command.delta_i, delta_i, self._trailer),
            _axis_step(
                state.hydrostat, now, command.hp, state.hydrostat.set_point, self._hydrostat
            ),
        )


def past_dead_time(
    under_way: tuple[tuple[int, float], ...], arrived: float, command: float, now: int, delay: int
) -> tuple[tuple[tuple[int, float], ...], float]:
    """Delay a command by `delay` physics steps.

    Args:
        under_way: commands that have not arrived, with their steps of arrival.
        arrived: newest command that has arrived.
        command: command that is sent at this step.
        now: number of this step.
        delay: dead time in steps.

    Returns:
        `under_way` and `arrived` after this step.
    """
    newest = under_way[-1][1] if under_way else arrived
    if command != newest:
        under_way = (*under_way, (now + delay, command))
    while under_way and under_way[0][0] <= now:
        arrived, under_way = under_way[0][1], under_way[1:]
    return under_way, arrived


def past_dead_band(sent: float, command: float, cylinder: float, dead_band: float) -> float:
    """Return the angle to which the valve moves the cylinder [rad].

    The valve opens by the part of the error e beyond its overlap, sign(e) (|e| - dead band), so
    that the cylinder stops short of the command by the dead band. Inside the overlap the valve is
    closed: a cylinder that has reached its last target stays; if the command has moved towards a
    cylinder that is still moving, the cylinder stops at its present angle.

    Args:
        sent: last return value of this function [rad].
        command: commanded angle [rad].
        cylinder: present angle of the cylinder [rad].
        dead_band: half width of the band [rad].
    """
    if not dead_band:
        return command
    error = command - cylinder
    if abs(error) > dead_band:
        return command - math.copysign(dead_band, error)
    return sent if abs(command - sent) <= dead_band + _ROUNDING else cylinder


def past_play(wheel: float, cylinder: float, play: float) -> float:
    """Return the angle of the wheel, at most half the play from that of the cylinder [rad]."""
    return min(max(wheel, cylinder - 0.5 * play), cylinder + 0.5 * play)


def _axis_step(state: AxisState, now: int, command: float, angle: float, axis: _Axis) -> AxisState:
    under_way, arrived = past_dead_time(
        state.under_way, state.arrived, quantised(command, axis.resolution), now, axis.delay
    )
    present = angle + (state.cylinder - state.set_point)  # angle of the cylinder
    cylinder = past_dead_band(state.cylinder, arrived, present, axis.dead_band)
    return AxisState(
        under_way, arrived, cylinder, past_play(state.set_point, cylinder, axis.backlash)
    )


def _steering_axis(name: str, valve: SteeringValve, timestep: float, stop: float) -> _Axis:
    """Return a steering axis in SI units; `stop` is its largest angle [rad]."""
    angles_deg = {
        "dead_band": valve.dead_band_deg,
        "backlash": valve.backlash_deg,
        "resolution": valve.resolution_deg,
    }
    angles = {key: math.radians(value) for key, value in angles_deg.items()}
    for key, value in angles.items():
        if value >= stop:
            raise InvalidPlant(
                f"actuators.{name}.{key}_deg: got {angles_deg[key]:g}, "
                f"must be below the stop at {math.degrees(stop):g}"
            )
    return _Axis(_delay(name, valve, timestep), **angles)


def _delay(name: str, valve: SteeringValve | HydrostatValve, timestep: float) -> int:
    return delay_steps(valve.dead_time_s, timestep, f"actuators.{name}.dead_time_s")
