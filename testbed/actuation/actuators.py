"""From the controller's command to the set points of the servos: what valves and linkages lose.

    command -> resolution -> dead time -> dead band -> play -> set point of the servo

Rate, lag and stops come after it and stand in `mjcf/`. Everything here is off by default. States
are data: a step takes one and returns the next, once a physics step, because a dead time ends
between two control ticks and a dead band looks at the present angle.

What the steering sensors and `Truth` call the steering angle is that of the wheel, behind the
play: it lies up to half the play aside of where the cylinder stands. Friction holds the wheel
while the cylinder crosses the play; the crossing itself takes no time.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Final, NamedTuple

from ttempc.types import Command

from ..discretisation import delay_steps, quantised
from ..errors import InvalidPlant

LONGEST_DEAD_TIME_S: Final = 2.0  # ten control periods: what is slower is no steering
_ROUNDING: Final = 1e-12  # [rad] a set point at the edge of the dead band is inside it


@dataclass(frozen=True, slots=True)
class SteeringValve:
    """What one steering axis loses on the way from command to wheel; SI units, off where 0.

    Raises:
        InvalidPlant: a value is not finite, negative, or a dead time above 2 s.
    """

    dead_time: float = 0.0  # [s] from command to valve: bus, solenoid, spool
    dead_band: float = 0.0  # [rad] overlap: smaller errors of the angle do not open the valve
    backlash: float = 0.0  # [rad] whole play between cylinder and wheel
    resolution: float = 0.0  # [rad] of the command as it is sent

    def __post_init__(self) -> None:
        _require_dead_time(self.dead_time)
        for item in fields(self):
            value = getattr(self, item.name)
            if not (math.isfinite(value) and value >= 0.0):
                raise InvalidPlant(
                    f"steering valve, {item.name}: got {value}, must be finite and not negative"
                )

    def notes(self) -> list[str]:
        """Return what is on, in words."""
        angles = ("dead_band", "backlash", "resolution")
        values = {name: math.degrees(getattr(self, name)) for name in angles}
        said = [f"dead time {self.dead_time:g} s"] if self.dead_time else []
        return said + [
            f"{name.replace('_', ' ')} {value:g} deg" for name, value in values.items() if value
        ]


@dataclass(frozen=True, slots=True)
class ActuatorSpecification:
    """What all actuators lose; nothing by default.

    Raises:
        InvalidPlant: a dead time that is not finite, negative or above 2 s.
    """

    front: SteeringValve = field(default_factory=SteeringValve)
    trailer: SteeringValve = field(default_factory=SteeringValve)
    hydrostat_dead_time: float = 0.0  # [s]

    def __post_init__(self) -> None:
        _require_dead_time(self.hydrostat_dead_time)

    def notes(self) -> list[str]:
        """Return a line for each actuator that has something on."""
        parts = {
            "front valve": self.front.notes(),
            "trailer valve": self.trailer.notes(),
            "hydrostat": SteeringValve(dead_time=self.hydrostat_dead_time).notes(),
        }
        return [f"actuators: {name} {', '.join(said)}" for name, said in parts.items() if said]


# Named tuples: made three times a physics step, they cost a third of a frozen dataclass.
class AxisState(NamedTuple):
    """One axis on its way from command to set point; [rad], the hydrostat's a fraction."""

    under_way: tuple[tuple[int, float], ...]  # physics step of arrival, command
    arrived: float  # newest command behind the dead time
    cylinder: float  # where the valve sends the cylinder
    set_point: float  # where the cylinder takes the wheel


class ActuatorState(NamedTuple):
    """Everything that the future of the command path depends on, besides the angles."""

    step: int  # physics steps since the start
    front: AxisState
    trailer: AxisState
    hydrostat: AxisState

    @property
    def set_points(self) -> tuple[float, float, float]:
        """What the servos get: both steering angles [rad] and the hydrostat's position."""
        return self.front.set_point, self.trailer.set_point, self.hydrostat.set_point


class _Axis(NamedTuple):
    delay: int  # physics steps
    valve: SteeringValve


class Actuators:
    """The command path of a vehicle.

    Args:
        specification: what each axis loses.
        timestep: physics step [s]; every dead time must be a whole number of them.
        stops: front and trailer steering angle at the stops [rad].

    Raises:
        InvalidPlant: a dead time between two steps; a dead band, backlash or resolution that
            reaches the stop, with which the axis could not be steered at all.
    """

    def __init__(
        self, specification: ActuatorSpecification, timestep: float, stops: tuple[float, float]
    ) -> None:
        self.specification = specification
        self.passive = not specification.notes()  # every command is a set point at once
        for name, valve, stop in (
            ("front", specification.front, stops[0]),
            ("trailer", specification.trailer, stops[1]),
        ):
            for key in ("dead_band", "backlash", "resolution"):
                if getattr(valve, key) >= stop:
                    raise InvalidPlant(
                        f"actuators.{name}.{key}_deg: got {math.degrees(getattr(valve, key)):g}, "
                        f"must be below the stop at {math.degrees(stop):g}"
                    )
        self._front, self._trailer, self._hydrostat = (
            _Axis(delay_steps(valve.dead_time, timestep, f"actuators.{name}.dead_time_s"), valve)
            for name, valve in (
                ("front", specification.front),
                ("trailer", specification.trailer),
                ("hydrostat", SteeringValve(dead_time=specification.hydrostat_dead_time)),
            )
        )

    def start(self, hp: float) -> ActuatorState:
        """Return the state of a vehicle that rolls straight with the hydrostat at `hp`."""
        straight, rolling = (AxisState((), value, value, value) for value in (0.0, hp))
        return ActuatorState(0, straight, straight, rolling)

    def step(
        self, state: ActuatorState, command: Command, delta_t: float, delta_i: float
    ) -> ActuatorState:
        """Return the state one physics step on, under `command` and the present angles [rad]."""
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
    """Return what is still under way and what has arrived at step `now`, `delay` steps late."""
    newest = under_way[-1][1] if under_way else arrived
    if command != newest:
        under_way = (*under_way, (now + delay, command))
    while under_way and under_way[0][0] <= now:
        arrived, under_way = under_way[0][1], under_way[1:]
    return under_way, arrived


def past_dead_band(sent: float, command: float, cylinder: float, dead_band: float) -> float:
    """Return where the valve sends the cylinder [rad].

    The valve opens with the error beyond its overlap, sign(e) (|e| - dead band), so that the
    cylinder stops that much short of the command. Within the overlap the oil is locked: the
    cylinder stays where it was sent or, where the command has come towards it since, where it is.

    Args:
        sent: what this function returned last.
        command: angle that is wanted.
        cylinder: present angle.
        dead_band: half width of the band.
    """
    if not dead_band:
        return command
    error = command - cylinder
    if abs(error) > dead_band:
        return command - math.copysign(dead_band, error)
    return sent if abs(command - sent) <= dead_band + _ROUNDING else cylinder


def past_play(wheel: float, cylinder: float, play: float) -> float:
    """Return the angle to which the cylinder takes the wheel, which follows at half the play."""
    return min(max(wheel, cylinder - 0.5 * play), cylinder + 0.5 * play)


def _axis_step(state: AxisState, now: int, command: float, angle: float, axis: _Axis) -> AxisState:
    valve = axis.valve
    under_way, arrived = past_dead_time(
        state.under_way, state.arrived, quantised(command, valve.resolution), now, axis.delay
    )
    at = angle + (state.cylinder - state.set_point)  # the wheel's angle plus what the play hides
    cylinder = past_dead_band(state.cylinder, arrived, at, valve.dead_band)
    return AxisState(
        under_way, arrived, cylinder, past_play(state.set_point, cylinder, valve.backlash)
    )


def _require_dead_time(value: float) -> None:
    if not 0.0 <= value <= LONGEST_DEAD_TIME_S:  # NaN is neither
        raise InvalidPlant(
            f"dead time of an actuator: got {value} s, must be in [0, {LONGEST_DEAD_TIME_S:g}]"
        )
