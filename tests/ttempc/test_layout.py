import math

import numpy as np
import pytest

from ttempc.errors import InvalidSamples
from ttempc.layout import SAMPLE, measurements_of, sample_rows
from ttempc.sensors import ROW_OF, SENSOR_COUNT, SensorIndex
from ttempc.types import Measurement, Sensor


def test_rows_of_samples_bear_the_numbers_of_the_kernels_and_give_the_samples_back() -> None:
    samples = [
        Measurement(
            0.1 * k,
            sensor,
            tuple(k + 0.25 * i for i in range(ROW_OF[sensor].length)),
            status=2 if sensor is Sensor.GNSS_TRAILER else 0,
        )
        for k, sensor in enumerate(Sensor)
    ]
    rows = sample_rows(samples)
    assert [SensorIndex(int(row[1])).name for row in rows] == [s.sensor.name for s in samples]
    assert measurements_of(rows) == samples


def test_rows_of_no_samples_and_of_impossible_ones() -> None:
    assert sample_rows([]).shape == (0, SAMPLE)
    assert measurements_of(np.empty((0, SAMPLE))) == []
    (row,) = sample_rows([Measurement(1.0, Sensor.GNSS_TRACTOR, (1.0,))])
    assert all(map(math.isnan, row[2:]))


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.zeros((2, 4)), r"\(2, 4\)"),
        (np.zeros(5), r"\(5,\)"),
        (np.full((1, SAMPLE), "1"), "numbers"),
        (np.full((3, SAMPLE), SENSOR_COUNT), f"sensor {SENSOR_COUNT} in row 0"),
        (np.array([[0.0, 1.0, 0, 0, 0], [0.0, -1.0, 0, 0, 0]]), "sensor -1 in row 1"),
        (np.full((1, SAMPLE), 0.5), "sensor 0.5"),
        (np.full((1, SAMPLE), math.nan), "sensor nan"),
    ],
)
def test_rows_of_another_shape_or_of_no_sensor_are_refused(rows, words) -> None:
    with pytest.raises(InvalidSamples, match=words):
        sample_rows(rows)


def test_rows_may_have_any_strides_and_type_of_number() -> None:
    rows = np.arange(40).reshape(8, SAMPLE)[:, ::-1] % 8
    assert sample_rows(rows).flags.c_contiguous
    np.testing.assert_array_equal(sample_rows(rows), rows)
