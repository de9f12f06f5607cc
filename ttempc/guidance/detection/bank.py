"""The detectors that a guidance has."""

from __future__ import annotations

from ...types import Input, Sensor
from .detector import Detector
from .innovation_monitor import InnovationMonitor
from .speed_monitors import MotionMonitor, WheelMonitor
from .speed_over_ground import SpeedOverGround
from .steering_monitor import SteeringMonitor


def detectors() -> tuple[Detector, ...]:
    """Return new detectors, each before its first tick.

    The steering angles have monitors of their own, since a dead time that was not learnt yet makes
    their innovations large. Innovations of the others grow with a fault of the sensor, and as much
    with wrong lengths or an assumed noise that is too small: the vehicle goes on, and learns.
    """
    ground = SpeedOverGround()
    return (
        SteeringMonitor(Input.DELTA_T),
        SteeringMonitor(Input.DELTA_I),
        WheelMonitor(ground),
        MotionMonitor(ground),
        InnovationMonitor("GNSS of the tractor", Sensor.GNSS_TRACTOR),
        InnovationMonitor("GNSS of the trailer", Sensor.GNSS_TRAILER),
        InnovationMonitor("hitch angle", Sensor.HITCH),
        InnovationMonitor("encoder", Sensor.ENCODER),
    )
