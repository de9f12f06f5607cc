"""Table of the built-in detectors: name, limit, reaction, excluded sensors, reason in words.

Limits of repetitions, steering, standstill, motion, wheels and innovations give at most one false
alarm in ten hours together on every shipped scenario, from drives with tuning seeds. Those of
hitch and position are set by hand above what fault-free drives reached; those of drift stand in
`drift`, by bins of the time since its onset. How often they are wrong is in the table of false
alarms of docs/appendix/faults.md.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from ..sensors import SENSORS, ReceiverFlag, Sensor
from .interface import Alarm, Reaction


class DetectorIndex(IntEnum):
    """Number of a built-in detector: its row in the table and in the board."""

    READINGS_GNSS_TRACTOR = 0  # the first six in the order of `SensorIndex`
    READINGS_GNSS_TRAILER = 1
    READINGS_STEERING_TRACTOR = 2
    READINGS_STEERING_TRAILER = 3
    READINGS_HITCH = 4
    READINGS_ENCODER = 5
    STEERING_FRONT = 6
    STEERING_TRAILER = 7
    STANDSTILL_FRONT = 8
    STANDSTILL_TRAILER = 9
    MOTION = 10
    WHEELS = 11
    INNOVATIONS_GNSS_TRACTOR = 12
    INNOVATIONS_GNSS_TRAILER = 13
    INNOVATIONS_HITCH = 14
    INNOVATIONS_ENCODER = 15
    HITCH = 16
    POSITION = 17
    DRIFT = 18
    PROTECTION = 19
    VELOCITY = 20
    VELOCITY_SURE = 21
    RECEIVER_TRACTOR = 22
    RECEIVER_TRAILER = 23
    DRIFT_SURE = 24
    AT_REST = 25
    STEPS = 26
    GYRO_TRACTOR = 27
    GYRO_TRAILER = 28
    CLOCK = 29
    MANY = 30
    HYDROSTAT = 31


COUNT: Final = len(DetectorIndex)
"""Number of built-in detectors."""

Words = Callable[[Reaction, Sequence[float]], str]
"""Makes the reason of an alarm from its reaction and its three numbers."""


@dataclass(frozen=True, slots=True)
class BuiltIn:
    """Row of the table: a built-in detector."""

    name: str
    limit: float  # above which the statistic begins an alarm
    reaction: Reaction
    words: str | Words  # a format of the three numbers, or a function
    sensors: tuple[Sensor, ...] = ()  # named in the alarm; `exclusion.py` decides what is excluded

    def alarm(self, reaction: Reaction, numbers: Sequence[float]) -> Alarm:
        """Return the alarm of a reaction and three numbers."""
        words = self.words
        reason = words.format(*numbers) if isinstance(words, str) else words(reaction, numbers)
        excludes = self.name != "wheels" or reaction is Reaction.WARN
        return Alarm(self.name, reason, reaction, frozenset(self.sensors if excludes else ()))


_BOTH_RECEIVERS: Final = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
"""Named by alarms of their common position; `exclusion.py` leaves them out while the vehicle
rolls."""


def _wheels(reaction: Reaction, numbers: Sequence[float]) -> str:
    wheels_mps, ground_mps, planned_mps = numbers
    words = f"wheels turn at {wheels_mps:.2f} m/s, GNSS moves at {ground_mps:.2f} m/s"
    if reaction is Reaction.WARN:
        words += f", planned {planned_mps:.2f} m/s: encoder not used"
    return words


_AGAINST_GROUND: Final = (
    "position drifts by {:.0f} cm/s against encoder and heading, {:.1f} m so far"
)
_AGAINST_VELOCITY: Final = (
    "position drifts by {:.1f} cm/s against the velocity of GNSS, {:.2f} m so far"
)


def _receiver(what: str) -> BuiltIn:
    def words(reaction: Reaction, numbers: Sequence[float]) -> str:
        flags, age_s, protection_m = numbers
        said = [
            flag.name.lower().replace("_", " ") for flag in ReceiverFlag(int(flags)) if flag.name
        ]
        if age_s > 0.0:
            said.append(f"corrections {age_s:.0f} s old")
        if protection_m > 0.0:
            said.append(f"protection level {protection_m:.1f} m")
        return f"receiver of the {what} says: {', '.join(said)}"

    return BuiltIn(
        name=f"receiver of the {what}",
        limit=0.5,  # of 1 where the receiver warns
        reaction=Reaction.WARN,  # `observe_receiver` chooses
        words=words,
    )


def _gyro(what: str, sensor: Sensor) -> BuiltIn:
    return BuiltIn(
        name=f"gyro of the {what}",
        limit=1.0,  # of comparisons in succession over their bound
        reaction=Reaction.WARN,
        words=f"IMU of the {what} contradicts the turn of the vehicle: not used",
        sensors=(sensor,),
    )


def _clock(reaction: Reaction, numbers: Sequence[float]) -> str:
    sensor, late_s, _ = numbers
    return f"time of {SENSORS[int(sensor)].sensor}: stamps run late by {late_s:.2f} s"


def _readings(what: str, sensor: Sensor) -> BuiltIn:
    return BuiltIn(
        name=f"readings of the {what}",
        limit=2.5,  # readings in succession; assumed
        reaction=Reaction.WARN,
        words=f"{what} repeats one reading: not used",
        sensors=(sensor,),
    )


def _steering(what: str) -> BuiltIn:
    return BuiltIn(
        name=what,
        limit=0.060,  # [rad]
        reaction=Reaction.STOP_ON_PATH,  # a valve that is slow steers better than one that is held
        words=f"{what} does not follow its command",
    )


def _standstill(what: str) -> BuiltIn:
    return BuiltIn(
        name=f"{what} at standstill",
        limit=0.035,  # [rad]
        reaction=Reaction.SLOW,  # until it is known whether the valve is stuck
        words=f"{what} stands still against its command",
    )


def _innovations(what: str, limit: float) -> BuiltIn:
    # They grow with a fault of the sensor, and as much with wrong lengths or an assumed noise that
    # is too small: the vehicle drives on, and learns. The steering angles have detectors of their
    # own, since a dead time that was not learnt yet makes their innovations large.
    return BuiltIn(
        name=f"innovations of the {what}",
        limit=limit,  # deviations of a standard normal variable
        reaction=Reaction.WARN,
        words=f"{what} contradicts the estimate",
    )


BUILT_IN: Final[dict[DetectorIndex, BuiltIn]] = {
    DetectorIndex.READINGS_GNSS_TRACTOR: _readings("GNSS of the tractor", Sensor.GNSS_TRACTOR),
    DetectorIndex.READINGS_GNSS_TRAILER: _readings("GNSS of the trailer", Sensor.GNSS_TRAILER),
    DetectorIndex.READINGS_STEERING_TRACTOR: _readings(
        "front steering angle", Sensor.STEERING_TRACTOR
    ),
    DetectorIndex.READINGS_STEERING_TRAILER: _readings(
        "trailer steering angle", Sensor.STEERING_TRAILER
    ),
    DetectorIndex.READINGS_HITCH: _readings("hitch angle", Sensor.HITCH),
    DetectorIndex.READINGS_ENCODER: _readings("encoder", Sensor.ENCODER),
    DetectorIndex.STEERING_FRONT: _steering("front steering"),
    DetectorIndex.STEERING_TRAILER: _steering("trailer steering"),
    DetectorIndex.STANDSTILL_FRONT: _standstill("front steering"),
    DetectorIndex.STANDSTILL_TRAILER: _standstill("trailer steering"),
    DetectorIndex.MOTION: BuiltIn(
        name="motion",
        limit=0.75,  # [m/s]
        reaction=Reaction.STOP_ON_PATH,
        words="planned speed {:.2f} m/s, GNSS moves at {:.2f} m/s",
    ),
    DetectorIndex.WHEELS: BuiltIn(
        name="wheels",
        limit=1.10,  # [m/s]
        reaction=Reaction.SLOW,  # `observe_wheels` chooses another where the encoder is wrong
        words=_wheels,
        sensors=(Sensor.ENCODER,),
    ),
    DetectorIndex.INNOVATIONS_GNSS_TRACTOR: _innovations("GNSS of the tractor", 7.8),
    DetectorIndex.INNOVATIONS_GNSS_TRAILER: _innovations("GNSS of the trailer", 7.8),
    DetectorIndex.INNOVATIONS_HITCH: _innovations("hitch angle", 8.3),
    DetectorIndex.INNOVATIONS_ENCODER: _innovations("encoder", 5.0),
    DetectorIndex.HITCH: BuiltIn(
        name="hitch",
        limit=1.0,  # of the larger of two ratios to bounds
        reaction=Reaction.WARN,
        words="hitch angle contradicts the motion of both bodies: not used",
        sensors=(Sensor.HITCH, Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER),  # a gyro may be what lies
    ),
    DetectorIndex.POSITION: BuiltIn(
        name="position",
        limit=1.0,  # of a distance over its bound
        reaction=Reaction.STOP_ON_PATH,
        words="position is {:.1f} m off dead reckoning",
        sensors=_BOTH_RECEIVERS,
    ),
    DetectorIndex.DRIFT: BuiltIn(
        name="drift",
        limit=1.0,  # of the largest of five ratios to limits
        reaction=Reaction.SLOW,
        words=_AGAINST_GROUND,
    ),
    DetectorIndex.PROTECTION: BuiltIn(
        name="protection level",
        limit=1.2,  # [m]
        reaction=Reaction.SLOW,
        words="position known to {:.1f} m without a sensor",
    ),
    DetectorIndex.VELOCITY: BuiltIn(
        name="velocity",
        limit=24.0,  # of a likelihood ratio; 20: three false alarms in ten hours
        reaction=Reaction.SLOW,
        words=_AGAINST_VELOCITY,
    ),
    DetectorIndex.VELOCITY_SURE: BuiltIn(
        name="velocity, second limit",
        limit=32.0,  # none in 22 h with 28
        reaction=Reaction.STOP_ON_PATH,
        words=_AGAINST_VELOCITY,
        sensors=_BOTH_RECEIVERS,
    ),
    DetectorIndex.RECEIVER_TRACTOR: _receiver("tractor"),
    DetectorIndex.RECEIVER_TRAILER: _receiver("trailer"),
    DetectorIndex.DRIFT_SURE: BuiltIn(
        name="drift, second limit",
        limit=1.5,
        reaction=Reaction.STOP_ON_PATH,
        words=_AGAINST_GROUND,
        sensors=_BOTH_RECEIVERS,
    ),
    DetectorIndex.AT_REST: BuiltIn(
        name="position at rest",
        limit=1.0,  # of a speed over its bound
        reaction=Reaction.STOP_ON_PATH,
        words="GNSS drifts by {:.1f} cm/s while the vehicle stands",
    ),
    DetectorIndex.STEPS: BuiltIn(
        name="steps",
        limit=1.0,  # of a distance over its bound
        reaction=Reaction.STOP_ON_PATH,
        words="both positions stepped by {:.2f} m together",
        sensors=_BOTH_RECEIVERS,
    ),
    DetectorIndex.GYRO_TRACTOR: _gyro("tractor", Sensor.IMU_TRACTOR),
    DetectorIndex.GYRO_TRAILER: _gyro("trailer", Sensor.IMU_TRAILER),
    DetectorIndex.CLOCK: BuiltIn(
        name="clock",
        limit=0.1,  # [s]
        reaction=Reaction.SLOW,
        words=_clock,
    ),
    DetectorIndex.MANY: BuiltIn(
        name="noise",
        limit=1.4,  # sensors
        reaction=Reaction.SLOW,
        words="{:.1f} sensors at a time contradict the estimate: their noise has grown",
    ),
    DetectorIndex.HYDROSTAT: BuiltIn(
        name="hydrostat",
        limit=0.5,  # [m/s]
        reaction=Reaction.WARN,
        words="hydrostat told {:.2f} m/s, wheels and GNSS go {:.2f} m/s: command not used",
    ),
}
"""Built-in detectors by index."""
