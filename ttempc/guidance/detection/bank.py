"""The detectors that a guidance has."""

from __future__ import annotations

from typing import Final

from ...types import Input, Sensor
from .detector import Detector, Reaction
from .innovation_monitor import InnovationMonitor
from .speed_monitors import MotionMonitor, WheelMonitor
from .steering_monitor import SteeringMonitor

_GNSS_S: Final = 2.0  # the gate's patience of a second, and the second of the monitor


def detectors() -> tuple[Detector, ...]:
    """Return new detectors, each before its first tick.

    The steering angles have monitors of their own, since a dead time that was not learnt yet makes
    their innovations large.
    """
    return (
        SteeringMonitor(Input.DELTA_T),
        SteeringMonitor(Input.DELTA_I),
        WheelMonitor(),
        MotionMonitor(),
        InnovationMonitor("GNSS of the tractor", Sensor.GNSS_TRACTOR, Reaction.SLOW, _GNSS_S),
        InnovationMonitor("GNSS of the trailer", Sensor.GNSS_TRAILER, Reaction.SLOW, _GNSS_S),
        InnovationMonitor("hitch angle", Sensor.HITCH, Reaction.SLOW),
        InnovationMonitor("encoder", Sensor.ENCODER, Reaction.GO_ON),
    )
