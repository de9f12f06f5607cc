"""Command path of the actuators: dead time, dead band, backlash, resolution and flow.

    command -> resolution -> dead time -> dead band -> play -> flow -> set point of the servo

The servos in `mjcf/` add rate limits, lags and stops behind it. Every effect is off by default.
The state is a flat array. A step runs once a physics step,
because a dead time may end between two control ticks and the dead band depends on the present
angle.

The steering angle of the sensors and of `Truth` is that of the wheel, behind the play: it differs
from the angle of the cylinder by up to half the play. Friction holds the wheel while the cylinder
crosses the play; the crossing itself takes no time.
"""

import math
from typing import Annotated, Any, Final, Protocol

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.jit import cached_njit
from ttempc.types import Command, FloatArray
from ttempc.vehicle import MAX_DEAD_TIME_S

from ..configuration.config_io import STRICT, NotNegative
from ..discretisation import whole_steps
from ..errors import InvalidPlant
from ..vehicle.vehicle import Steering

_ROUNDING: Final = 1e-12  # [rad] a set point at the edge of the dead band is inside it

Flow = Annotated[float, Field(gt=0, le=1)]
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
    flow_left: Flow = 1.0
    """Speed of the angle to the left at an opening of the valve, over that of the vehicle file. The
    areas of a single-rod cylinder differ by 1.3 to 1.6; cold oil lowers both flows."""
    flow_right: Flow = 1.0
    """The same to the right."""


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


_STEP, _CYLINDER, _SET_POINT, _WHEEL, _UNDER_WAY = 0, 1, 4, 7, 10
"""Places in the state: steps since the start; of each axis the angle to which the valve moves the
cylinder, the set point, the angle to which the cylinder moves the wheel; then the commands under
way, in rings."""


class CommandPath(Protocol):
    """Way from a command to the set points, with or without faults; its state is its own."""

    def start(self, hp: float) -> Any:  # noqa: ANN401 - a state of its own
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""

    def step(self, state: Any, command: Command, delta_t: float, delta_i: float) -> Any:  # noqa: ANN401
        """Return the state after one physics step; the arguments are the present angles [rad]."""

    def set_points(self, state: Any) -> tuple[float, float, float]:  # noqa: ANN401
        """Return the servos' front and trailer angle [rad] and the hydrostat's position."""
        ...


class Actuators:
    """The command path of a vehicle.

    Args:
        specification: effects of each axis.
        timestep: physics step [s]; every dead time must be a whole number of steps.
        steering: front and trailer steering of the vehicle.

    Raises:
        InvalidPlant: a dead time is not a whole number of steps, or a dead band, backlash or
            resolution is not below the stop, so that the axis could not be steered at all.
    """

    def __init__(
        self,
        specification: ActuatorSpecification,
        timestep: float,
        steering: tuple[Steering, Steering],
    ) -> None:
        self.specification = specification
        # every command is a set point at once
        self.passive = specification == ActuatorSpecification()
        self.axes: Final = np.array(
            [
                _steering_axis("front", specification.front, timestep, steering[0]),
                _steering_axis("trailer", specification.trailer, timestep, steering[1]),
                (_delay("hydrostat", specification.hydrostat, timestep), *3 * [0.0], *3 * [1.0]),
            ]
        )  # (3, 7) of `move_valves`

    def start(self, hp: float) -> FloatArray:
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""
        front, trailer, hydrostat = self.axes[:, 0].astype(int)
        return np.array([0.0, *(0.0, 0.0, hp) * 3, *(front + trailer) * [0.0], *hydrostat * [hp]])

    def step(
        self, state: FloatArray, command: Command, delta_t: float, delta_i: float
    ) -> FloatArray:
        """Return the state after one physics step; the arguments are the present angles [rad]."""
        state = state.copy()
        move_valves(self.axes, state, command.as_array(), delta_t, delta_i)
        return state

    def set_points(self, state: FloatArray) -> tuple[float, float, float]:
        """Return the servos' front and trailer angle [rad] and the hydrostat's position."""
        front, trailer, hydrostat = state[_SET_POINT:_WHEEL].tolist()
        return front, trailer, hydrostat


@cached_njit(error_model="numpy", boundscheck=False)
def move_valves(
    axes: FloatArray, state: FloatArray, command: FloatArray, delta_t: float, delta_i: float
) -> None:
    """Advance the command path by one physics step, in place.

    Args:
        axes: (3, 7) of front, trailer and hydrostat: dead time in steps, half width of the dead
            band, whole play, resolution, error of the angle at which the valve is fully open [rad],
            flows to the left and to the right.
        state: (10 + steps of all dead times,) as from `Actuators.start`; entries 4 to 6 are the set
            points.
        command: (3,) that is sent at this step.
        delta_t, delta_i: present steering angles [rad].
    """
    now, ring = int(state[_STEP]), _UNDER_WAY
    state[_STEP] = now + 1
    for axis in range(3):
        delay, dead_band, play = int(axes[axis, 0]), axes[axis, 1], axes[axis, 2]
        resolution, arrived = axes[axis, 3], command[axis]
        if resolution > 0.0:
            arrived = resolution * np.rint(arrived / resolution)
        if delay:
            place = ring + now % delay
            state[place], arrived = arrived, state[place]
            ring += delay
        cylinder, wheel = state[_CYLINDER + axis], state[_WHEEL + axis]
        angle = delta_t if axis == 0 else (delta_i if axis == 1 else wheel)
        cylinder = past_dead_band(cylinder, arrived, angle + (cylinder - wheel), dead_band)
        state[_CYLINDER + axis] = cylinder
        state[_WHEEL + axis] = state[_SET_POINT + axis] = wheel = past_play(wheel, cylinder, play)
        if axes[axis, 5] < 1.0 or axes[axis, 6] < 1.0:
            # the servo turns at (set point - angle) / lag
            opening = min(max(wheel - angle, -axes[axis, 4]), axes[axis, 4])
            flow = axes[axis, 5] if opening > 0.0 else axes[axis, 6]
            state[_SET_POINT + axis] = angle + flow * opening


@cached_njit(inline="always")
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
    if dead_band == 0.0:
        return command
    error = command - cylinder
    if abs(error) > dead_band:
        return command - math.copysign(dead_band, error)
    return sent if abs(command - sent) <= dead_band + _ROUNDING else cylinder


@cached_njit(inline="always")
def past_play(wheel: float, cylinder: float, play: float) -> float:
    """Return the angle of the wheel, at most half the play from that of the cylinder [rad]."""
    return min(max(wheel, cylinder - 0.5 * play), cylinder + 0.5 * play)


def _steering_axis(
    name: str, valve: SteeringValve, timestep: float, steering: Steering
) -> tuple[float, ...]:
    """Return the row of a steering axis in `Actuators.axes`."""
    angles_deg = {
        "dead_band": valve.dead_band_deg,
        "backlash": valve.backlash_deg,
        "resolution": valve.resolution_deg,
    }
    for key, value in angles_deg.items():
        if value >= steering.limit_deg:
            raise InvalidPlant(
                f"actuators.{name}.{key}_deg: got {value:g}, "
                f"must be below the stop at {steering.limit_deg:g}"
            )
    angles = (*angles_deg.values(), steering.rate_degps * steering.lag_s)
    flows = valve.flow_left, valve.flow_right
    return (_delay(name, valve, timestep), *map(math.radians, angles), *flows)


def _delay(name: str, valve: SteeringValve | HydrostatValve, timestep: float) -> int:
    return whole_steps(valve.dead_time_s, timestep, f"actuators.{name}.dead_time_s", least=0)
