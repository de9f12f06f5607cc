import math

import numpy as np

from ttempc.layout import SAMPLE, measurements_of, sample_rows
from ttempc.models.augmented_state import LENGTH, SensorIndex
from ttempc.types import Measurement, Sensor


def test_rows_of_samples_bear_the_numbers_of_the_kernels_and_give_the_samples_back() -> None:
    samples = [
        Measurement(
            0.1 * k,
            sensor,
            tuple(k + 0.25 * i for i in range(LENGTH.get(sensor, 3))),
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
