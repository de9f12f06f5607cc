"""Limits of the detectors, from drives without faults."""
from typing import Final
from ...types import Sensor
STEERING_ALLOWANCE: Final = 0.026
STEERING: Final = 0.1
WHEELS_ALLOWANCE: Final = 0.3
WHEELS: Final = 0.6
MOTION_ALLOWANCE: Final = 0.35
MOTION: Final = 0.8
INNOVATION: Final = {
    Sensor.GNSS_TRACTOR: 6.0,
    Sensor.GNSS_TRAILER: 6.0,
    Sensor.HITCH: 8.0,
    Sensor.ENCODER: 6.0,
}
