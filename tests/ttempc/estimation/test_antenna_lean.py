"""Correction of antenna positions for the lean of the vehicle."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.ttempc.sensed_drive import GNSS, VEHICLE, SensedDrive
from ttempc.errors import InvalidTuning
from ttempc.estimation.ekf import ExtendedKalmanFilter, LeverArm
from ttempc.estimation.noise import SensorNoise
from ttempc.types import Measurement, Sensor, State

HEIGHTS = (1.8, 1.2)


def imu(sensor, time_s, roll, pitch):
    return Measurement(time_s, sensor, (0.0, roll, pitch))


@pytest.mark.parametrize(
    ("body", "gnss", "sensor"),
    [
        (0, Sensor.GNSS_TRACTOR, Sensor.IMU_TRACTOR),
        (1, Sensor.GNSS_TRAILER, Sensor.IMU_TRAILER),
    ],
)
def test_a_position_moves_by_the_lever_arm_turned_by_yaw_pitch_and_roll(body, gnss, sensor):
    generator = np.random.default_rng(81)
    for _ in range(10):
        yaw, pitch, roll = generator.uniform(-1.0, 1.0, 3) * (3.0, 0.3, 0.3)
        turn = Rotation.from_euler("ZYX", (yaw, pitch, roll))
        east, north, _ = turn.apply((0.0, 0.0, HEIGHTS[body]))
        arm, headings = LeverArm(HEIGHTS, 1.0), [9.0, 9.0]
        headings[body] = yaw
        antenna = Measurement(0.2, gnss, (5.0 + east, 3.0 + north))
        point, _ = arm.corrected([antenna, imu(sensor, 0.2, roll, pitch)], tuple(headings))
        np.testing.assert_allclose(point.value, (5.0, 3.0), atol=1e-12)


def test_a_late_position_is_corrected_with_the_attitude_of_its_time():
    arm = LeverArm(HEIGHTS, 1.0)
    arm.corrected([imu(Sensor.IMU_TRACTOR, t, t, 0.0) for t in (0.0, 0.1, 0.2, 0.3)], (0.0, 0.0))
    late = Measurement(0.1, Sensor.GNSS_TRACTOR, (0.0, 0.0))
    (point,) = arm.corrected([late], (0.0, 0.0))
    assert point.value[1] == pytest.approx(HEIGHTS[0] * math.sin(0.1))


def test_without_height_or_attitude_samples_stay_as_they_are():
    samples = [Measurement(0.2, Sensor.GNSS_TRACTOR, (5.0, 3.0))]
    assert LeverArm(HEIGHTS, 1.0).corrected(samples, (0.0, 0.0)) == samples
    samples.append(imu(Sensor.IMU_TRACTOR, 0.2, 0.1, 0.1))
    samples.append(imu(Sensor.IMU_TRACTOR, 0.2, math.nan, 0.1))
    assert LeverArm((0.0, 0.0), 1.0).corrected(samples, (0.0, 0.0)) == samples


def test_a_filter_with_imu_drives_through_a_lean_of_six_degrees():
    """The antennas are 19 and 13 cm beside their points; the corrected filter does not see it."""
    roll = 0.105

    def corrupt(measurements):
        leaning = []
        for m in measurements:
            if m.sensor in GNSS:
                body = m.sensor is Sensor.GNSS_TRAILER
                sensor = Sensor.IMU_TRAILER if body else Sensor.IMU_TRACTOR
                leaning.append(imu(sensor, m.time_s, roll, 0.0))
                yaw = drive.states[-1][2 + body] if drive.states else math.atan2(0.0, 1.0)
                aside = HEIGHTS[body] * math.sin(roll)
                shift = (aside * math.sin(yaw), -aside * math.cos(yaw))
                m = Measurement(m.time_s, m.sensor, tuple(np.add(m.value, shift).tolist()))
            leaning.append(m)
        return leaning

    errors = {}
    for heights in ((0.0, 0.0), HEIGHTS):
        noise = SensorNoise(antenna_height_t=heights[0], antenna_height_i=heights[1])
        drive = SensedDrive(13, corrupt=corrupt, estimator=ExtendedKalmanFilter(VEHICLE, noise))
        errors[heights] = np.hypot(*drive.run(150).errors()[50:, : State.PSI_T].T).mean()
    assert errors[0.0, 0.0] > 0.1
    assert errors[HEIGHTS] < 0.03


def test_a_height_below_zero_is_refused():
    with pytest.raises(
        InvalidTuning, match=r"antenna_height_t: got -1.0, must be finite and 0 or above"
    ):
        SensorNoise(antenna_height_t=-1.0)
