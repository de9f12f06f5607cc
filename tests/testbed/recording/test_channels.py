"""Rows of the channels: every number stands under the name of its field."""

import math

import numpy as np
import pytest
from proving_ground.testbed.recording.channels import (
    ERROR,
    MEASUREMENT,
    REFERENCE,
    STATE,
    TYRES,
    error_rows,
    measurement_rows,
)
from proving_ground.testbed.sensing.sensors import COMPONENTS
from proving_ground.testbed.truth import STATE_COLUMNS, TYRE_COLUMNS, WHEELS

from tests.testbed.plants import ROLL, plant_on
from tests.testbed.truths import moments
from ttempc.layout import sample_rows
from ttempc.types import Measurement


def named(channel, row):
    return dict(zip(channel.fields, row, strict=True))


@pytest.fixture(scope="module")
def driven():
    plant = plant_on()
    plant.reset(1.0, 2.0, 0.3, 1.0)
    return plant.advance(ROLL, 100)


def test_a_sample_stands_under_the_names_of_its_components_beside_its_time():
    for sensor, parts in COMPONENTS.items():
        value = tuple(10.0 + k for k in range(len(parts)))
        status = 0
        if parts[-1] == "status":
            *value, status = value
        samples = sample_rows([Measurement(0.7, sensor, tuple(value), status)] * 2)
        value = (*value, status) if status else value
        times, rows = measurement_rows(samples, np.zeros(2), np.array([0.9]))
        assert times.tolist() == [0.9, 0.9], "a row has one sample of a sensor"
        np.testing.assert_array_equal(*rows)
        row = named(MEASUREMENT, rows[0])
        pairs = zip((*parts, "time_s"), (*value, 0.7), strict=True)
        expected = {f"{sensor}_{part}": number for part, number in pairs}
        assert {name: number for name, number in row.items() if not math.isnan(number)} == expected


def test_rows_of_the_truth_stand_under_their_names(driven):
    (row,) = moments(driven).rows
    state = named(STATE, row[STATE_COLUMNS])
    assert state["x_t_m"] == driven.tractor.x
    assert state["psi_i_rad"] == driven.trailer.yaw
    assert state["roll_i_rad"] == driven.trailer.roll
    assert state["psi_d_rad"] == driven.psi_d
    assert state["hp"] == driven.hp
    assert state["yaw_rate_i_radps"] == driven.yaw_rate_i
    assert state["v_rim_mps"] == driven.wheel_speed
    assert state["hp_set_point"] == driven.set_points[2]
    tyres = named(TYRES, row[TYRE_COLUMNS])
    for index, wheel in enumerate(WHEELS):
        assert tyres[f"{wheel}_load_n"] == driven.wheels.load[index]
        assert tyres[f"{wheel}_force_lat_n"] == driven.wheels.force_lat[index]
        assert tyres[f"{wheel}_ground_m"] == driven.wheels.ground[index]


def test_the_true_error_is_in_the_frame_of_the_reference():
    """A point 3 m ahead and 4 m to the left of a reference that heads north lies to its west."""
    state, reference = np.zeros((1, len(STATE.fields))), np.zeros((1, len(REFERENCE.fields)))
    due = {"x_t_m": 10.0, "y_t_m": 20.0, "psi_t_rad": 0.5 * math.pi}
    at = {"x_t_m": 6.0, "y_t_m": 23.0, "psi_t_rad": 2.5 * math.pi + 0.1}
    for row, channel, values in ((reference, REFERENCE, due), (state, STATE, at)):
        for name, value in values.items():
            row[0, channel.fields.index(name)] = value
    row = error_rows(state, reference)[0]
    error = dict(zip(ERROR.fields, row, strict=True))
    assert [error[f"tractor_{part}_m"] for part in ("along", "cross", "euclidean")] == (
        pytest.approx([3.0, 4.0, 5.0])
    )
    assert error["tractor_heading_rad"] == pytest.approx(0.1)
    assert error["trailer_euclidean_m"] == 0.0
