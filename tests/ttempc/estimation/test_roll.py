"""Roll as an input of the filter: axle points step aside as the bodies tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.reference.estimation.augmented_state import augmented_rate, predicted_measurement
from tests.ttempc.sensed_drive import VEHICLE, SensedDrive
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.filter.records import SNAPSHOT, SNAPSHOT_SIZE, GyroColumn
from ttempc.estimation.filter.sample import tilt_of_hitch_angle
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.models.augmented_state import SIZE, STATES, AugmentedState
from ttempc.sensors import STARTING_SENSORS, Body
from ttempc.types import Command, Estimate, FloatArray, Measurement, Sensor, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
SAMPLE_S = 0.02  # of all sensors
STEPS = 10  # of integration between two samples
SPEED_MPS = 1.0
TICKS = 40
SWING_RAD = 0.06
FLAT = replace(VEHICLE, axle_height_t=0.0, axle_height_i=0.0)
IMUS = (Sensor.IMU_TRACTOR, Sensor.IMU_TRAILER)

TURN = Command(delta_t=0.2, delta_i=-0.1, hp=SPEED_MPS / VEHICLE.speed_gain)
"""A curve to the left, in which the trailer stands at an angle to the tractor."""

ARM_M = VEHICLE.trailer_length + VEHICLE.drawbar_length * math.cos(TURN.delta_i)
BEND = (VEHICLE.axle_height_t - VEHICLE.axle_height_i) / ARM_M
"""Yaw of the trailer itself beyond that of the flat model, per rad of roll of both bodies."""

Samples = list[list[Measurement]]


@dataclass
class Tilting:
    """Vehicle on a curve whose bodies roll: the model with the side slip of its axle points.

    An axle point h above the ground moves to the left at -h times the rate of roll. The trailer's
    yaw in the flat model is that of the line from RJ1 to its axle point. RJ1 is halfway between the
    heights of both axle points, so that the trailer itself stands `bend` further to the left.
    """

    rolling: tuple[float, float]  # share of the swing of tractor and trailer

    def samples(self) -> Samples:
        """Return the noise-free samples of every tick."""
        x = np.zeros(SIZE)
        x[: STATES - 1] = 1.0, 2.0, 0.4, 0.1, TURN.delta_t, TURN.delta_i
        x[AugmentedState.WHEEL_SPEED] = SPEED_MPS
        ticks = [[*self._sample(x, 0.0), *self._attitude(x, 0.0)]]
        for k in range(1, TICKS):
            ticks.append([])
            for j in range(1, round(PERIOD_S / SAMPLE_S) + 1):
                time_s = (k - 1) * PERIOD_S + j * SAMPLE_S
                self._advance(x, time_s - SAMPLE_S)
                ticks[-1] += [*self._sample(x, time_s), *self._attitude(x, time_s)]
        return ticks

    def _rolls(self, time_s: float) -> FloatArray:
        """Return roll and its rate of both bodies, (2, 2)."""
        swing = np.array([math.sin(4.0 * time_s), 4.0 * math.cos(4.0 * time_s)])
        return SWING_RAD * np.outer(self.rolling, swing)

    def _advance(self, x: FloatArray, time_s: float) -> None:
        """Integrate over a sample with the midpoint rule."""
        step_s = SAMPLE_S / STEPS
        for n in range(STEPS):
            middle = x.copy()
            for share in (0.5, 1.0):
                self._slip(middle, time_s + (n + 0.5) * step_s)
                rate = augmented_rate(middle, TURN.as_array(), VEHICLE)[:STATES]
                middle[:STATES] = x[:STATES] + share * step_s * rate
            x[:STATES] = middle[:STATES]

    def _slip(self, x: FloatArray, time_s: float) -> None:
        """Write the side slips with which both axle points move to the left as they do."""
        rate_t, rate_i = self._rolls(time_s)[:, 1]
        x[AugmentedState.SLIP_T] = -VEHICLE.axle_height_t * rate_t / SPEED_MPS
        x[AugmentedState.SLIP_I] = -VEHICLE.axle_height_i * rate_i / SPEED_MPS

    def _sample(self, x: FloatArray, time_s: float) -> list[Measurement]:
        values = {
            sensor: predicted_measurement(sensor, x, VEHICLE)[0] for sensor in STARTING_SENSORS
        }
        values[Sensor.HITCH] = (self._hitch_angle(x, time_s),)
        return [Measurement(time_s, sensor, tuple(value)) for sensor, value in values.items()]

    def _hitch_angle(self, x: FloatArray, time_s: float) -> float:
        """Return the angle of the drawbar about the vertical of the tractor itself."""
        roll_t, roll_i = self._rolls(time_s)[:, 0]
        psi_i = x[State.PSI_I] + BEND * self._rolls(time_s)[:, 0].mean()
        tractor = Rotation.from_euler("ZYX", (x[State.PSI_T], 0.0, roll_t))
        trailer = Rotation.from_euler("ZYX", (psi_i, 0.0, roll_i))
        delta_i = x[State.DELTA_I]
        drawbar = trailer.apply((math.cos(delta_i), math.sin(delta_i), 0.0))
        ahead, left, _ = tractor.inv().apply(drawbar)
        return -math.atan2(left, ahead)

    def _attitude(self, x: FloatArray, time_s: float) -> list[Measurement]:
        middle = x.copy()
        self._slip(middle, time_s)
        rate = augmented_rate(middle, TURN.as_array(), VEHICLE)
        rate[State.PSI_I] += BEND * self._rolls(time_s)[:, 1].mean()
        rolls = self._rolls(time_s)[:, 0]
        return [
            Measurement(time_s, sensor, (rate[State.PSI_T + body], rolls[body], 0.0))
            for body, sensor in enumerate(IMUS)
        ]


BLIND: Final = SensorNoise(hitch=1e6)
"""Noise of a hitch angle that tells nothing: the tilt of its tractor is in it."""


def estimates_of(
    ticks: Samples, vehicle: Vehicle = VEHICLE, noise: SensorNoise | None = None
) -> list[Estimate]:
    """Return the estimates over the samples of a curve of a filter without slip by the slope."""
    estimator = ExtendedKalmanFilter(vehicle, noise, ProcessNoise(side_per_slope=0.0))
    return [estimator.update(k * PERIOD_S, samples, TURN) for k, samples in enumerate(ticks)]


def largest_innovation(estimates: list[Estimate]) -> float:
    """Return the largest normalised squared innovation."""
    return max(i.normalised_squared for e in estimates for i in e.innovations)


@pytest.fixture(scope="module")
def tilting() -> Samples:
    return Tilting((1.0, -0.5)).samples()


@pytest.mark.parametrize("rolling", [(1.0, 0.0), (0.0, 1.0), (1.0, -0.5)])
def test_an_axle_that_steps_aside_by_roll_is_no_surprise(rolling):
    """The filter follows the truth without innovation; one with points at ground level does not."""
    ticks = Tilting(rolling).samples()
    followed = largest_innovation(estimates_of(ticks))
    surprised = largest_innovation(estimates_of(ticks, FLAT))
    assert followed < 0.01
    assert surprised > 30.0 * followed


def without_roll(ticks: Samples, *imus: Sensor) -> Samples:
    """Return the samples with IMUs that show no roll."""
    return [
        [replace(m, value=(m.value[0], 0.0, 0.0)) if m.sensor in imus else m for m in samples]
        for samples in ticks
    ]


def test_axle_points_at_ground_level_take_nothing_from_roll(tilting):
    level = without_roll(tilting, *IMUS)
    ones = estimates_of(tilting, FLAT, BLIND)
    others = estimates_of(level, FLAT, BLIND)
    for one, other in zip(ones, others, strict=True):
        np.testing.assert_allclose(one.state, other.state, atol=1e-9)
        np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-9)


def test_a_tool_in_the_soil_holds_the_axle_of_the_trailer(tilting):
    """With a tool, and axle points of one height, roll of the trailer moves nothing."""
    tool = replace(VEHICLE, tool_behind=1.0, axle_height_i=VEHICLE.axle_height_t)
    one = estimates_of(tilting, tool, BLIND)[-1]
    other = estimates_of(without_roll(tilting, Sensor.IMU_TRAILER), tool, BLIND)[-1]
    np.testing.assert_allclose(one.state, other.state, atol=1e-9)


@pytest.mark.parametrize("yaw", [0.4, -2.0])
def test_on_a_slope_points_and_headings_are_those_of_rigid_bodies(yaw):
    """A vehicle stands straight on a plane: the trailer point is that below its antenna.

    Both axle points stand their heights above the plane, along its normal. The yaw of the trailer
    in the estimate is the one with which the flat model has the trailer point there.
    """
    vehicle = replace(VEHICLE, axle_height_t=0.8, axle_height_i=0.4)
    turn = Rotation.from_euler("ZYX", (yaw, -0.05, 0.12))
    _, pitch, roll = turn.as_euler("ZYX")
    behind = vehicle.hitch_offset + vehicle.drawbar_length + vehicle.trailer_length
    tractor = turn.apply((0.0, 0.0, vehicle.axle_height_t))[:2]
    trailer = turn.apply((-behind, 0.0, vehicle.axle_height_i))[:2]
    values = {
        Sensor.GNSS_TRACTOR: tuple(tractor),
        Sensor.GNSS_TRAILER: tuple(trailer),
        Sensor.IMU_TRACTOR: (0.0, roll, pitch),
        Sensor.IMU_TRAILER: (0.0, roll, pitch),
    }
    estimator = ExtendedKalmanFilter(vehicle)
    for k in range(150):
        samples = [
            Measurement(k * PERIOD_S, sensor, values.get(sensor, (0.0,)))
            for sensor in (*IMUS, *STARTING_SENSORS)
        ]
        estimate = estimator.update(k * PERIOD_S, samples, Command(0.0, 0.0, 0.0))
    assert np.hypot(*(estimate.trailer_xy - trailer)) < 0.01
    arm = vehicle.trailer_length + vehicle.drawbar_length
    left = (vehicle.axle_height_t - vehicle.axle_height_i) * math.sin(roll)
    assert abs(estimate.state[State.PSI_T] - yaw) < 0.002
    assert estimate.state[State.PSI_I] == pytest.approx(yaw - left / arm, abs=0.002)


def mirrored(ticks: Samples) -> Samples:
    """Return the samples of the vehicle's mirror image, left and right exchanged."""
    sign = {
        Sensor.GNSS_TRACTOR: (1.0, -1.0),
        Sensor.GNSS_TRAILER: (1.0, -1.0),
        Sensor.ENCODER: (1.0,),
        Sensor.IMU_TRACTOR: (-1.0, -1.0, 1.0),
        Sensor.IMU_TRAILER: (-1.0, -1.0, 1.0),
    }
    return [
        [
            replace(m, value=tuple(np.multiply(m.value, sign.get(m.sensor, (-1.0,)))))
            for m in samples
        ]
        for samples in ticks
    ]


def test_the_mirror_image_has_the_mirrored_estimate(tilting):
    estimator = ExtendedKalmanFilter(VEHICLE)
    turn = Command(-TURN.delta_t, -TURN.delta_i, TURN.hp)
    ones = estimates_of(tilting)
    for k, samples in enumerate(mirrored(tilting)):
        other = estimator.update(k * PERIOD_S, samples, turn)
        mirror = np.array([1.0, -1.0, -1.0, -1.0, -1.0, -1.0, 1.0])
        np.testing.assert_allclose(other.state, mirror * ones[k].state, atol=1e-9)
        expected = np.outer(mirror, mirror) * ones[k].covariance
        np.testing.assert_allclose(other.covariance, expected, atol=1e-9)


def test_a_late_roll_is_inserted_where_it_belongs(tilting):
    """Samples of the IMUs come up to four periods late, in random order; the last are in time."""
    generator = np.random.default_rng(4)
    late: Samples = [[] for _ in tilting]
    for k, samples in enumerate(tilting):
        for sample in samples:
            delay = generator.integers(5) if sample.sensor in IMUS and 0 < k < TICKS - 4 else 0
            late[k + delay].append(sample)
    for samples in late:
        generator.shuffle(samples)
    one = estimates_of(tilting)[-1]
    other = estimates_of(late)[-1]
    np.testing.assert_array_equal(other.state, one.state)
    np.testing.assert_array_equal(other.covariance, one.covariance)


def test_noise_of_roll_neither_accumulates_nor_is_left_out():
    """Level vehicles, IMUs of very noisy roll: poses are as far off as claimed."""
    noise = SensorNoise(attitude=math.radians(2.0))
    squares = []
    for seed in range(61, 65):
        drive = SensedDrive(seed).run(200)
        generator = np.random.default_rng(seed)
        yaw = np.unwrap(np.array(drive.states)[:, State.PSI_T : State.DELTA_T], axis=0)
        rates = np.diff(yaw, axis=0) / PERIOD_S
        estimator = ExtendedKalmanFilter(VEHICLE, noise)
        for k, (samples, command) in enumerate(drive.received):
            imus = []
            for time_s in (k * PERIOD_S - PERIOD_S + 0.04 * np.arange(1, 6)).tolist():
                for body, sensor in enumerate(IMUS):
                    rate = rates[max(k - 1, 0), body] + noise.yaw_rate * generator.normal()
                    roll = noise.attitude * generator.normal()
                    imus.append(Measurement(time_s, sensor, (rate, roll, 0.0)))
            estimate = estimator.update(k * PERIOD_S, [*imus, *samples], command)
            error = (drive.states[k] - estimate.state)[: State.DELTA_T]
            if k >= 50:
                covariance = estimate.covariance[: State.DELTA_T, : State.DELTA_T]
                squares.append(error @ np.linalg.solve(covariance, error) / len(error))
    assert 0.5 < np.mean(squares) < 1.5


@pytest.mark.parametrize("seed", range(20))
def test_a_hitch_angle_is_one_about_the_vertical_of_a_tilted_tractor(seed):
    """Turned by RJ1, yaw, pitch and roll in this order, and by RJ2, the tractor is the trailer."""
    generator = np.random.default_rng(seed)
    yaw, beta, delta_i = generator.uniform((-3.0, -1.0, -0.4), (3.0, 1.0, 0.4))
    pitch_t, roll_t, pitch_d, roll_d = generator.uniform(-0.25, 0.25, 4)
    tractor = Rotation.from_euler("ZYX", (yaw, pitch_t, roll_t))
    drawbar = tractor * Rotation.from_euler("ZYX", (-beta, pitch_d, roll_d))
    trailer = drawbar * Rotation.from_euler("Z", -delta_i)
    psi_i, pitch_i, roll_i = trailer.as_euler("ZYX")

    snapshot = np.zeros(SNAPSHOT_SIZE)
    now = snapshot.view(SNAPSHOT)[0]
    now["augmented"][0, : State.DELTA_I + 1] = 0.0, 0.0, yaw, psi_i, 0.0, delta_i
    now["gyros"][Body.TRACTOR, GyroColumn.ROLL :] = roll_t, pitch_t
    now["gyros"][Body.TRAILER, GyroColumn.ROLL :] = roll_i, pitch_i

    flat = math.remainder(yaw - psi_i - delta_i, math.tau)
    assert tilt_of_hitch_angle(snapshot) == pytest.approx(beta - flat, abs=1e-12)
    assert abs(tilt_of_hitch_angle(snapshot)) > 1e-4
