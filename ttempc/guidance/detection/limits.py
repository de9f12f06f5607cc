"""Allowances and limits of the detectors.

An allowance is half of the shift of a residual that is to be detected, as usual for a cumulative
sum (Montgomery, Introduction to Statistical Quality Control, ch. 9). The shifts are assumed: a
steering angle 2.5 deg off its command, and a speed that is 0.6 m/s, in the case of motion 0.7 m/s,
off.

The limits are those at which all detectors together give at most one false alarm in ten hours on
every shipped scenario, or above: `python -m experiments.studies.faults.calibration` gives them,
from tuning seeds. Both steering angles, and both receivers, have the larger one of the two.
`python -m experiments.studies.faults.false_alarms` counts the alarms on other seeds.
"""

from __future__ import annotations

import math
from typing import Final

from ...types import Sensor

STEERING_ALLOWANCE: Final = math.radians(1.25)
STEERING: Final = 0.035  # [rad] of a valve that stands still
STEERING_STOP: Final = 0.060  # [rad] of any valve
WHEELS_ALLOWANCE: Final = 0.30  # [m/s]
WHEELS: Final = 1.10  # [m/s]
MOTION_ALLOWANCE: Final = 0.35  # [m/s]
MOTION: Final = 0.75  # [m/s]
REPETITIONS: Final = 2.5  # bit-identical readings in succession; assumed
INNOVATION: Final = {
    Sensor.GNSS_TRACTOR: 7.8,
    Sensor.GNSS_TRAILER: 7.8,
    Sensor.HITCH: 8.3,
    Sensor.ENCODER: 5.0,
}
"""Standard normal equivalents."""
