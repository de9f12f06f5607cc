"""The detectors that a guidance has."""

from __future__ import annotations

from typing import Final

from ...types import Input, Sensor
from .detector import Detector
from .innovation_monitor import InnovationMonitor
from .limits import INNOVATION
from .planned_speed import PlannedSpeed
from .repetition_monitor import RepetitionMonitor
from .speed_monitors import MotionMonitor, WheelMonitor
from .speed_over_ground import SpeedOverGround
from .steering_monitor import StandstillMonitor, SteeringMonitor, SteeringResponse

_SENSORS: Final = {
    Sensor.GNSS_TRACTOR: "GNSS of the tractor",
    Sensor.GNSS_TRAILER: "GNSS of the trailer",
    Sensor.STEERING_TRACTOR: "front steering angle",
    Sensor.STEERING_TRAILER: "trailer steering angle",
    Sensor.HITCH: "hitch angle",
    Sensor.ENCODER: "encoder",
}


def detectors() -> tuple[Detector, ...]:
    """Return new detectors, each before its first tick.

    The steering angles have monitors of their own, since a dead time that was not learnt yet makes
    their innovations large. Innovations of the others grow with a fault of the sensor, and as much
    with wrong lengths or an assumed noise that is too small: the vehicle goes on, and learns.
    """
    ground, plan = SpeedOverGround(), PlannedSpeed()
    responses = [(axis, SteeringResponse(axis)) for axis in (Input.DELTA_T, Input.DELTA_I)]
    return (
        *(RepetitionMonitor(what, sensor) for sensor, what in _SENSORS.items()),
        *(SteeringMonitor(axis, response) for axis, response in responses),
        *(StandstillMonitor(axis, response) for axis, response in responses),
        MotionMonitor(ground, plan),
        WheelMonitor(ground, plan),  # may rule out the encoder, which those above do not use
        *(InnovationMonitor(_SENSORS[sensor], sensor) for sensor in INNOVATION),
    )
