"""Time-based reference: on the path, with inputs that keep the articulated model there."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from ttempc.errors import InvalidReference
from ttempc.models.kinematics import trailer_point
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))


def test_both_axle_points_are_on_the_path():
    sample = REFERENCE.on_grid(0.2)
    path = REFERENCE.path
    np.testing.assert_allclose(sample.state[:, :2], path.pose(sample.distance_m)[:, :2], atol=1e-12)
    for state, trailer in zip(sample.state[::50], sample.trailer_xy[::50], strict=True):
        np.testing.assert_allclose(trailer_point(state, VEHICLE), trailer, atol=1e-12)
    # nearest point of a dense path
    dense = path.pose(np.arange(-3.0, path.lap_m, 0.001))[:, :2]
    for trailer in sample.trailer_xy[::97]:
        assert np.min(np.hypot(*(dense - trailer).T)) < 6e-4


def test_speeds_and_yaw_rates_are_the_derivatives():
    t, h = np.linspace(1.0, 130.0, 997), 1e-4
    before, after, now = REFERENCE.at(t - h), REFERENCE.at(t + h), REFERENCE.at(t)
    velocity = (after.trailer_xy - before.trailer_xy) / (2 * h)
    np.testing.assert_allclose(np.hypot(velocity[:, 0], velocity[:, 1]), now.speed_i, atol=1e-6)
    turning = (after.state - before.state) / (2 * h)
    np.testing.assert_allclose(turning[:, State.PSI_T], now.yaw_rate_t, atol=1e-5)
    np.testing.assert_allclose(turning[:, State.PSI_I], now.yaw_rate_i, atol=1e-5)
    np.testing.assert_allclose(now.psi_d, now.state[:, State.PSI_I] + now.state[:, State.DELTA_I])


@pytest.mark.parametrize("speed", [0.5, 1.0, 1.25])
def test_feedforward_keeps_the_articulated_model_on_the_reference(speed):
    reference = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(speed))
    step_s = 0.02
    state = reference.at(0.0).state
    middle = np.arange(int(reference.duration_s / step_s)) * step_s + 0.5 * step_s
    inputs, expected = reference.at(middle).inputs, reference.at(middle + 0.5 * step_s)
    for k, (u, r, r_i) in enumerate(zip(inputs, expected.state, expected.trailer_xy, strict=True)):
        state = advance(state, u, VEHICLE, step_s)
        if k % 50 == 0:
            np.testing.assert_allclose(state, r, atol=2e-3)
            np.testing.assert_allclose(trailer_point(state, VEHICLE), r_i, atol=2e-3)


def test_steady_inputs_are_the_textbook_ones():
    sample = REFERENCE.at(35.0)  # on the first arc
    delta_t, delta_i, hp = sample.inputs
    assert delta_t == pytest.approx(math.atan(VEHICLE.wheelbase * 0.1))
    assert math.degrees(delta_i) == pytest.approx(15.4, abs=0.05)
    assert hp == pytest.approx(1.0 / VEHICLE.speed_gain)


def test_grid_covers_the_run_and_more():
    sample = REFERENCE.on_grid(0.2, beyond=8)
    assert sample.time_s[-9] >= REFERENCE.duration_s - 1e-9
    np.testing.assert_allclose(np.diff(sample.time_s), 0.2)
    single = REFERENCE.at(sample.time_s[17])
    np.testing.assert_allclose(single.state, sample.state[17], atol=1e-12)


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan, math.inf, 1.5])
def test_speeds_that_cannot_be_driven_are_refused(speed):
    with pytest.raises(InvalidReference, match="speed"):
        Reference(figure_eight(), VEHICLE, ConstantSpeed(speed))
