"""The table of the sensors, and what the filter does with those that it does not know."""

import numpy as np
import pytest

from tests.ttempc.sensed_drive import PERIOD_S, VEHICLE, SensedDrive
from ttempc import sensors
from ttempc.errors import UnknownSensor
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.filter import records
from ttempc.estimation.noise import SensorNoise
from ttempc.layout import SAMPLE, SampleColumn, sample_rows
from ttempc.models.augmented_state import SIZE, vehicle_parameters
from ttempc.models.measurement import EQUATIONS, measure
from ttempc.sensors import (
    GNSS_OF_BODY,
    IMU_OF_BODY,
    INNOVATION_SIZES,
    NEEDED_AT_START,
    ROW_OF,
    SENSOR_BODIES,
    SENSOR_COUNT,
    SENSOR_KINDS,
    SENSOR_LENGTHS,
    SENSORS,
    STARTING_SENSORS,
    Body,
    Sensor,
    SensorIndex,
    SensorKind,
)


def test_the_table_has_every_sensor_once_at_its_index():
    assert [row.index for row in SENSORS] == list(SensorIndex) == list(range(SENSOR_COUNT))
    assert [row.sensor for row in SENSORS] == list(Sensor)
    for sensor, row in ROW_OF.items():
        assert SENSOR_KINDS[row.index] == row.kind
        assert SENSOR_BODIES[row.index] == row.body
        assert SENSOR_LENGTHS[row.index] == len(row.components)
        assert INNOVATION_SIZES[row.index] <= SENSOR_LENGTHS[row.index]
        assert NEEDED_AT_START[row.index] == (sensor in STARTING_SENSORS)


def test_each_body_has_the_receiver_and_the_imu_of_its_name():
    for body in Body:
        assert SENSORS[GNSS_OF_BODY[body]].sensor == f"gnss_{body.name.lower()}"
        assert SENSORS[IMU_OF_BODY[body]].sensor == f"imu_{body.name.lower()}"
        assert SENSORS[IMU_OF_BODY[body]].kind is SensorKind.INERTIAL


@pytest.mark.parametrize("index", range(-1, SENSOR_COUNT + 2))
def test_an_equation_gives_the_entries_of_the_table_and_no_sensor_gives_none(index):
    reading, jacobian = np.zeros(2), np.empty((2, SIZE))
    x, parameters = np.full(SIZE, 0.1), vehicle_parameters(VEHICLE)
    size = measure(index, x, parameters, 0.04, reading, jacobian)
    known = index in EQUATIONS
    assert size == (INNOVATION_SIZES[index] if known else 0)
    assert jacobian.any() == known


def test_a_sensor_without_an_equation_is_refused_by_name(monkeypatch):
    monkeypatch.setattr(records, "EQUATIONS", EQUATIONS - {SensorIndex.HITCH})
    with pytest.raises(UnknownSensor, match=r"hitch.*measurement\.py"):
        ExtendedKalmanFilter(VEHICLE)


def test_the_noise_of_a_sensor_that_does_not_exist_is_refused():
    with pytest.raises(UnknownSensor, match=r"radar.*gnss_tractor"):
        SensorNoise().of("radar")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("number", [SENSOR_COUNT, 40.0, -1.0, np.nan, np.inf])
def test_rows_of_no_sensor_change_nothing_and_touch_no_memory(number):
    """Also where they come to the filter without the check of `sample_rows`."""
    received = SensedDrive(3).run(8).received
    stray = np.full((2, SAMPLE), 0.1)
    stray[:, SampleColumn.SENSOR] = number
    plain, disturbed = ExtendedKalmanFilter(VEHICLE), ExtendedKalmanFilter(VEHICLE)
    for tick, (samples, command) in enumerate(received):
        time_s = PERIOD_S * tick
        stray[:, SampleColumn.TIME_S] = time_s
        rows = sample_rows(samples)
        inputs = np.full(3, np.nan) if command is None else command.as_array()
        expected, _ = plain.observe(time_s, rows, inputs)
        estimate, innovations = disturbed.observe(time_s, np.concatenate([rows, stray]), inputs)
        np.testing.assert_array_equal(estimate, expected)
        assert not innovations[len(rows) :].any()
    assert disturbed.snapshots().tobytes() == plain.snapshots().tobytes()


def test_the_module_of_types_has_the_same_sensors():
    from ttempc import types

    assert types.Sensor is sensors.Sensor
