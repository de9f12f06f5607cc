"""Noise models of the filter: standard deviations of the sensors and of the process."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Final

import numpy as np

from ..errors import InvalidTuning, UnknownSensor, check_positive
from ..models.augmented_state import SIZE, STATES, AugmentedState
from ..sensors import OTHERS, ROW_OF, Body, SensorKind
from ..types import FloatArray, Sensor
from ..vehicle import Vehicle


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """Standard deviations of the sensors; the defaults are the paper's, sec. II.

    Raises:
        InvalidTuning: a value is not finite or not above 0.

    Examples:
        >>> SensorNoise(gnss=0.015).of(Sensor.GNSS_TRACTOR)  # RTK of 1.5 cm
        0.015
    """

    gnss: float = 0.03  # [m] each axis, white and slow part together
    gnss_white_share: float = 1.0  # of the variance; the rest is slow, alike for both receivers
    gnss_correlation_s: float = 60.0  # of the slow part [s]; assumed
    gnss_correlation_m: float = 0.0  # distance over which it fades as well [m]; 0: by time alone
    gnss_shared: float = 0.0  # share of the slow variance that is common to both receivers
    gnss_float: float = 0.0  # [m] of a float solution, as white noise; 0: like any other
    # Of the antennas above the axle points [m], for the correction of their lever-arm tilt with the
    # IMUs; 0 where a receiver reports the axle point
    antenna_height_t: float = 0.0
    antenna_height_i: float = 0.0
    attitude: float = math.radians(0.2)  # roll and pitch of the IMUs [rad]; assumed
    attitude_bias: float = math.radians(0.3)  # constant part of their error [rad]; assumed
    angle_offset: float = 0.0  # offset of a sensor of an angle, over runs [rad]; 0: none
    steering: float = math.radians(1.0)  # both steering angles [rad]
    hitch: float = math.radians(1.0)  # [rad]; not printed, assumed as for the steering angles
    encoder: float = 0.1  # [m/s]
    yaw_rate: float = math.radians(0.1)  # of the IMUs [rad/s]; 0: not used; assumed
    yaw_rate_bias: float = math.radians(0.05)  # of their yaw rate at the start [rad/s]; assumed
    yaw_rate_walk: float = 1e-5  # random walk of this bias [(rad/s)/sqrt(s)]; assumed
    velocity_wander: float = 0.002  # slow part of the velocities of GNSS, common [m/s]; assumed
    # Sensors that are not the paper's, with the standard deviation of an entry of a sample; one
    # that is not named is not used
    others: tuple[tuple[Sensor, float], ...] = ()

    def __post_init__(self) -> None:
        for item in fields(self):
            if item.name == OTHERS:
                continue
            zero = item.default == 0.0 or item.name in ("antenna_height_t", "yaw_rate")
            check_positive(f"SensorNoise.{item.name}", getattr(self, item.name), zero=zero)
        for sensor, sd in self.others:
            check_positive(f"SensorNoise.{OTHERS}: {sensor}", sd, zero=True)
        if self.gnss_white_share > 1.0:
            raise InvalidTuning(
                f"SensorNoise.gnss_white_share: got {self.gnss_white_share}, must be at most 1"
            )

    @property
    def slow_variance(self) -> float:
        """Variance of half the sum of both receivers' slow errors along an axis [m^2]."""
        return 0.5 * (1.0 + self.gnss_shared) * (1.0 - self.gnss_white_share) * self.gnss**2

    @property
    def difference_variance(self) -> float:
        """Variance of half the difference of both receivers' slow errors along an axis [m^2].

        A bias of the attitude is in it as if it were fixed in the map: it turns with the vehicle.
        """
        own = 0.5 * (1.0 - self.gnss_shared) * (1.0 - self.gnss_white_share) * self.gnss**2
        return own + (0.5 * self.lever_arm_bias) ** 2

    @property
    def lever_arm_bias(self) -> float:
        """Standard deviation of the shift between the antennas by a bias of both attitudes [m]."""
        return math.hypot(self.antenna_height_t, self.antenna_height_i) * self.attitude_bias

    @property
    def position_variance(self) -> float:
        """Variance of the tractor point along an axis [m^2] that no sample can reduce."""
        return self.slow_variance + (self.antenna_height_t * self.attitude_bias) ** 2

    @property
    def gnss_forgets(self) -> tuple[float, float]:
        """Rates at which the slow part fades, in a second and in a metre."""
        distance = self.gnss_correlation_m
        per_metre = 1.0 / distance if distance > 0.0 else 0.0
        return 1.0 / self.gnss_correlation_s, per_metre

    def of(self, sensor: Sensor) -> float:
        """Return the standard deviation of each entry of one sample of `sensor`, the white part.

        Raises:
            UnknownSensor: the sensor has no noise.
        """
        row = ROW_OF.get(sensor)
        if row is None:
            raise UnknownSensor(f"sensor: got {sensor}, must be one of {', '.join(ROW_OF)}")
        if row.kind is SensorKind.POSITION:
            height = self.antenna_height_t
            if row.body is Body.TRAILER:
                height = self.antenna_height_i
            white = self.gnss * math.sqrt(self.gnss_white_share)
            return math.hypot(white, height * self.attitude)
        if row.noise == OTHERS:
            return dict(self.others).get(sensor, 0.0)
        return getattr(self, row.noise)


class NoiseScale(IntEnum):
    """Index of each factor of process variances that the filter learns."""

    GROUND = 0  # roughness: bumps and soil, felt by both bodies and the steering linkages
    WHEEL = 1  # change of the persistent wheel slip over the distance
    VALVES = 2  # deviation of both steering valves from their model


SCALES: Final = len(NoiseScale)

SCALE_RANGE: Final = ((1e-3, 100.0), (1e-3, 2.0), (1e-1, 1e4))
"""Least and largest value of each factor that a filter learns; assumed."""

_OFFSET_WALK: Final = 0.02  # of an angle's offset in a metre, of its size [1/sqrt(m)]; assumed
_VEHICLE: Final = slice(AugmentedState.X, AugmentedState.DELTA_T)
_STEERING: Final = slice(AugmentedState.DELTA_T, AugmentedState.WHEEL_SPEED)


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """White noise of the model of `augmented_state`, in physical terms.

    The effect of slip and bumps grows with the square root of the distance travelled; a vehicle at
    rest gathers none. Valves and drive act at any time. Persistent disturbances - a slope, soft
    soil, a biased sensor - are entries of the augmented state, which perform a random walk and fade
    over a distance. All else is noise on the state itself.

    The size of three groups depends on the ground and on the age of the vehicle, which are not
    known beforehand. The filter learns a factor of the variances of each group (`NoiseScale`) from
    the likelihood of its innovations; the values given here hold for a factor of 1.

    Values are maximum-likelihood estimates from the innovations of one recorded run each on
    `pavement`, `grass`, `wet-grass`, `side-slope`, `wet-slope` and `patchy`, but for those marked
    as assumed, for the valves, and for `slip_walk`, `side_walk` and `drive_walk`, the likeliest of
    four combinations tried on five fields. The walks of the persistent side slips grow with the
    roughness: with that, the innovations of even fields and of slopes are both more likely than
    with fixed ones.

    Raises:
        InvalidTuning: a value is not finite or not above 0.
    """

    # Variances that are proportional to the factor GROUND
    slip_forward: float = 0.0057  # wheel slip, bumps: position along the tractor [m/sqrt(m)]
    slip_lateral: float = 0.0056  # rear axle side slip: position across the tractor [m/sqrt(m)]
    yaw_t: float = 0.014  # side slip of the front axle: yaw of the tractor [rad/sqrt(m)]
    yaw_i: float = 0.006  # side slip of the trailer axle: yaw of the trailer [rad/sqrt(m)]
    bump_steering: float = 0.001  # forces on both steering linkages [rad/sqrt(m)]
    slip_walk: float = 0.0002  # random walk of the persistent side slips [rad/sqrt(m)]
    side_walk: float = 0.0004  # random walk of the side slip on a slope [rad/sqrt(m)]
    # Variances that are proportional to the factor WHEEL
    wheel_walk: float = 0.0057  # random walk of the persistent wheel slip [1/sqrt(m)]
    climb_walk: float = 0.0014  # random walk of the wheel slip on a slope [1/sqrt(m)]
    # Variances that are proportional to the factor VALVES
    # Ten times the likeliest values, 0.00165 and 0.0009: an angle is believed of its sensor, not of
    # a command that a dead time nobody told may delay. At 1 m/s that changes no error by 0.2 %; at
    # 4 m/s with 0.2 s of such a dead time 14 cm remain of 47
    steering: float = 0.0165  # front steering valve [rad/sqrt(s)]
    steering_i: float = 0.009  # the trailer's steering valve [rad/sqrt(s)]
    # Variances that no factor changes
    drive: float = 0.0017  # hydrostat: speed of the wheels [(m/s)/sqrt(s)]
    steering_walk: float = 0.0005  # random walk of the steering disturbance [rad/sqrt(m)]
    joint: float = 0.0005  # turn of RJ2 off its set point by loads, at the start [rad]; assumed
    joint_walk: float = 0.0002  # random walk of it at a factor WHEEL of 1 [rad/sqrt(m)]
    drive_walk: float = 0.0003  # random walk of the drive disturbance [(m/s^2)/sqrt(s)]

    side_per_slope: float = 0.0  # moves the side slip by the IMUs' slope [rad/rad]; 0: not used
    slip_per_slope: float = 0.2  # tells the slope's size by that slip, without IMUs; assumed
    body_fading_m: float = 120.0  # distance over which a body-fixed disturbance fades by 1/e [m]
    gyro_sampling: float = 0.0004  # yaw between samples of a gyro [rad/sqrt(m)]; from records
    bump_m: float = 0.085  # correlation length of the wheel slip on bumps [m]; from recorded speeds
    map_fading_m: float = 500.0  # distance over which a map-fixed one fades by 1/e [m]; assumed
    # Initial factors, the standard deviation of their logarithm, and its random walk [1/sqrt(m)]
    roughness: float = 0.5
    wheel: float = 0.2
    valves: float = 1.0
    scale_sd: float = 1.0
    scale_walk: float = 0.05

    def __post_init__(self) -> None:
        for item in fields(self):
            zero = item.default == 0.0
            check_positive(f"ProcessNoise.{item.name}", getattr(self, item.name), zero=zero)

    @classmethod
    def of(cls, vehicle: Vehicle) -> ProcessNoise:
        """Return the noise of a vehicle.

        A tool in the soil pushes the trailer wherever soil and depth change, and steadies it. With
        one, slips have the values of least error at the tool on four laps of `cultivate`; vehicles
        without a tool track worse with them. `side_walk` is a compromise of these curves with
        passes of 80 and 200 m at 1.4, 2.8 and 4.2 m/s, on level ground and slopes (seeds 11 to 13):
        the value of the curves alone, 0.0036, has errors larger by 9 to 20 % on the passes.
        `body_fading_m` is a compromise of curves and passes of 200 m too, of 10 to 120 m (seeds 21
        to 23): a tool that is lowered after a turn meets less of the side slips that were estimated
        in it, and the tractor's error in turns is larger.
        """
        if not vehicle.tool_behind:
            return cls()
        return cls(
            slip_walk=0.0006,
            side_walk=0.001,
            yaw_i=0.0053,
            joint_walk=0.00022,
            slip_lateral=0.0112,
            yaw_t=0.007,
            side_per_slope=0.17,
            body_fading_m=30.0,
        )

    @property
    def scales(self) -> FloatArray:
        """Initial factors in the order of `NoiseScale`, (3,)."""
        return np.array([self.roughness, self.wheel, self.valves])

    def rates(self, sensors: SensorNoise) -> FloatArray:
        """Return the variances of each entry that a second and a metre add, (2, 4, 24).

        The first index is 0 for a second and 1 for a metre; of the second index, 0 is fixed
        and 1 + n belongs to a factor 1 of the n-th `NoiseScale`. Positions are along and across
        the tractor. They are those that GNSS reports: the common slow error of both receivers moves
        the vehicle.
        """
        state = AugmentedState
        deviations = np.zeros((2, 1 + SCALES, SIZE))
        per_second, per_metre = deviations
        per_second[0, state.WHEEL_SPEED] = self.drive
        per_second[0, state.DRIVE] = self.drive_walk
        per_metre[0, state.STEERING] = self.steering_walk
        valves = per_second[1 + NoiseScale.VALVES]
        valves[_STEERING] = self.steering, self.steering_i
        ground = per_metre[1 + NoiseScale.GROUND]
        ground[[state.SLIP_T, state.SLIP_I]] = self.slip_walk
        ground[[state.SIDE_X, state.SIDE_Y]] = self.side_walk
        ground[_VEHICLE] = self.slip_forward, self.slip_lateral, self.yaw_t, self.yaw_i
        ground[_STEERING] = self.bump_steering
        wheel = per_metre[1 + NoiseScale.WHEEL]
        wheel[state.WHEEL] = self.wheel_walk
        wheel[[state.CLIMB_X, state.CLIMB_Y]] = self.climb_walk

        # The slow errors of the receivers: density of a first-order process (Gelb 1974, sec. 3.6)
        for of_span, rate in zip(deviations, sensors.gnss_forgets, strict=True):
            common = math.sqrt(2.0 * sensors.slow_variance * rate)
            of_span[0, [state.X, state.Y]] = common
            difference = math.sqrt(2.0 * sensors.difference_variance * rate)
            of_span[0, [state.GNSS_X, state.GNSS_Y]] = difference

        # Offsets and biases of sensors
        per_metre[0, [state.OFFSET_I, state.OFFSET_HITCH]] = _OFFSET_WALK * sensors.angle_offset
        if not sensors.angle_offset:
            wheel[state.OFFSET_I] = self.joint_walk
        if sensors.yaw_rate:
            per_second[0, [state.GYRO_T, state.GYRO_I]] = sensors.yaw_rate_walk
        return np.square(deviations)

    def fading(self, sensors: SensorNoise) -> FloatArray:
        """Return the rates at which each disturbance fades, (2, 17): in a second, in a metre."""
        rates = np.zeros((2, SIZE))
        per_metre = rates[1]
        per_metre[AugmentedState.SLIP_T : AugmentedState.SIDE_X] = 1.0 / self.body_fading_m
        per_metre[AugmentedState.SIDE_X : AugmentedState.GNSS_X] = 1.0 / self.map_fading_m
        if sensors.difference_variance > 0.0:
            of_gnss = [AugmentedState.GNSS_X, AugmentedState.GNSS_Y]
            rates[:, of_gnss] = np.array(sensors.gnss_forgets)[:, None]
        return rates[:, STATES:]
