"""Command path of the actuators: dead time, dead band, backlash, resolution and flow.

    command -> resolution -> dead time -> dead band -> backlash -> flow -> set point of the servo

The servos in `mjcf/` add rate limits, lags and stops behind it. Every effect is off by default.
The state is a flat array. A step runs once a physics step,
because a dead time may end between two control ticks and the dead band depends on the present
angle.

The steering angle of the sensors and of `Truth` is that of the wheel, behind the backlash: it
differs from the angle of the cylinder by up to half the backlash. Friction holds the wheel while
the cylinder crosses the backlash; the crossing itself takes no time.
"""

import math
from typing import Annotated, Any, Final, Protocol

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.jit import cached_njit, record
from ttempc.types import Command, FloatArray
from ttempc.vehicle import MAX_DEAD_TIME_S

from ..configuration.config_io import STRICT, NotNegative
from ..discretisation import whole_steps
from ..errors import InvalidPlant
from ..kernel_options import KERNEL
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
    """Whole angle between cylinder and wheel."""
    resolution_deg: NotNegative = 0.0
    """Resolution of the command as it is sent."""
    flow_left: Flow = 1.0
    """Speed of the angle to the left at an opening of the valve, over that of the vehicle file. The
    areas of a single-rod cylinder differ by 1.3 to 1.6; cold oil lowers both flows."""
    flow_right: Flow = 1.0
    """Speed of the angle to the right at an opening of the valve, over that of the vehicle file."""


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


_AXES: Final = 3  # front steering, trailer steering, hydrostat

VALVE: Final = np.dtype(
    [
        ("delay", np.float64),  # dead time in physics steps
        ("dead_band", np.float64),  # [rad] half width
        ("backlash", np.float64),  # [rad] whole angle between cylinder and wheel
        ("resolution", np.float64),  # [rad] of the command; 0: exact
        ("full_opening", np.float64),  # [rad] error of the angle at which the valve is fully open
        ("flow_left", np.float64),  # over the flow of the vehicle file
        ("flow_right", np.float64),
    ]
)
"""Constants of one axis."""

VALVE_STATE: Final = np.dtype(
    [
        ("step", np.float64),  # physics steps since the start
        ("cylinder", np.float64, (_AXES,)),  # angle to which the valve moves the cylinder
        ("set_point", np.float64, (_AXES,)),  # angle or position that the servo is given
        ("wheel", np.float64, (_AXES,)),  # angle to which the cylinder moves the wheel
    ]
)
"""State of all axes; the commands under way follow it, in a ring an axis."""

_STATE_SIZE: Final = VALVE_STATE.itemsize // 8


class CommandPath(Protocol):
    """Path from a command to the set points, with or without faults; its state is its own."""

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
                _hydrostat_axis(specification.hydrostat, timestep),
            ]
        )  # rows `VALVE` of front, trailer and hydrostat

    def start(self, hp: float) -> FloatArray:
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""
        straight = (0.0, 0.0, hp)
        state = np.zeros((), VALVE_STATE)
        for name in ("cylinder", "set_point", "wheel"):
            state[name] = straight
        delays = self.axes[:, 0].astype(int)
        return np.concatenate([state.reshape(1).view(np.float64), np.repeat(straight, delays)])

    def step(
        self, state: FloatArray, command: Command, delta_t: float, delta_i: float
    ) -> FloatArray:
        """Return the state after one physics step; the arguments are the present angles [rad]."""
        state = state.copy()
        move_valves(self.axes, state, command.as_array(), delta_t, delta_i)
        return state

    def set_points(self, state: FloatArray) -> tuple[float, float, float]:
        """Return the servos' front and trailer angle [rad] and the hydrostat's position."""
        front, trailer, hydrostat = state[:_STATE_SIZE].view(VALVE_STATE)["set_point"][0].tolist()
        return front, trailer, hydrostat


@cached_njit(**KERNEL)
def move_valves(
    axes: FloatArray, state: FloatArray, command: FloatArray, delta_t: float, delta_i: float
) -> None:
    """Advance the command path by one physics step, in place.

    Args:
        axes: (3, 7) rows `VALVE` of front, trailer and hydrostat.
        state: (n,) `VALVE_STATE`, then the rings, as from `Actuators.start`.
        command: (3,) that is sent at this step.
        delta_t, delta_i: present steering angles [rad].
    """
    valves = record(state, VALVE_STATE)
    now = int(valves.step)
    valves.step = now + 1.0
    ring = _STATE_SIZE

    for axis in range(_AXES):
        valve = record(axes[axis], VALVE)
        arrived = command[axis]
        if valve.resolution > 0.0:
            arrived = valve.resolution * np.rint(arrived / valve.resolution)

        # dead time: the ring returns the command of `delay` steps ago
        delay = int(valve.delay)
        if delay:
            place = ring + now % delay
            sent = arrived
            arrived = state[place]
            state[place] = sent
            ring += delay

        # dead band and backlash; the hydrostat has neither
        cylinder = valves.cylinder[axis]
        wheel = valves.wheel[axis]
        angle = wheel
        if axis == 0:
            angle = delta_t
        elif axis == 1:
            angle = delta_i
        cylinder_angle = angle + (cylinder - wheel)
        cylinder = past_dead_band(cylinder, arrived, cylinder_angle, valve.dead_band)
        wheel = past_backlash(wheel, cylinder, valve.backlash)
        valves.cylinder[axis] = cylinder
        valves.wheel[axis] = wheel

        # flow: the servo turns at (set point - angle) / lag
        set_point = wheel
        if valve.flow_left < 1.0 or valve.flow_right < 1.0:
            opening = min(max(wheel - angle, -valve.full_opening), valve.full_opening)
            flow = valve.flow_left if opening > 0.0 else valve.flow_right
            set_point = angle + flow * opening
        valves.set_point[axis] = set_point


@cached_njit(**KERNEL)
def put_set_points(state: FloatArray, ctrl: FloatArray) -> None:
    """Write the set points into MuJoCo's controls, (3,)."""
    valves = record(state, VALVE_STATE)
    for axis in range(_AXES):
        ctrl[axis] = valves.set_point[axis]


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
def past_backlash(wheel: float, cylinder: float, backlash: float) -> float:
    """Return the angle of the wheel, at most half the backlash from that of the cylinder [rad]."""
    return min(max(wheel, cylinder - 0.5 * backlash), cylinder + 0.5 * backlash)


def _steering_axis(
    name: str, valve: SteeringValve, timestep: float, steering: Steering
) -> tuple[float, ...]:
    """Return the row `VALVE` of a steering axis."""
    angles_deg = {
        "dead_band": valve.dead_band_deg,
        "backlash": valve.backlash_deg,
        "resolution": valve.resolution_deg,
    }
    for key, value in angles_deg.items():
        if value >= steering.limit_deg and value > 0.0:
            raise InvalidPlant(
                f"actuators.{name}.{key}_deg: got {value:g}, "
                f"must be below the stop at {steering.limit_deg:g}"
            )
    full_opening_deg = steering.rate_degps * steering.lag_s
    angles = map(math.radians, (*angles_deg.values(), full_opening_deg))
    return (_delay(name, valve, timestep), *angles, valve.flow_left, valve.flow_right)


def _hydrostat_axis(valve: HydrostatValve, timestep: float) -> tuple[float, ...]:
    """Return the row `VALVE` of the hydrostat, which has a dead time only."""
    constants = np.zeros(1, VALVE)
    constants["delay"] = _delay("hydrostat", valve, timestep)
    constants["flow_left"] = 1.0
    constants["flow_right"] = 1.0
    return constants[0].item()


def _delay(name: str, valve: SteeringValve | HydrostatValve, timestep: float) -> int:
    return whole_steps(valve.dead_time_s, timestep, f"actuators.{name}.dead_time_s", least=0)
