"""Tubes along the figure eight: tightened bounds, refusals, search of the gain."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, VEHICLE, WEIGHTS, WINDOW, along
from ttempc.errors import InvalidTube
from ttempc.mpc.articulated_error import remaining_bounds
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import InputMargin, gain_schedule, search_weights
from ttempc.tube.tube import TrackingSystem, invariant_tube
from ttempc.types import Input
from ttempc.vehicle import CommandLimits

ALONG = along()
LIMITS = CommandLimits.of(VEHICLE, PERIOD_S)
MOTIONS = [20, 120]  # a straight, an arc


def test_tightened_bounds_and_the_tube_add_up_to_the_limits():
    tube, bounds = ALONG.tube, ALONG.bounds
    whole = remaining_bounds(ALONG.feedforward, LIMITS)
    for edge, taken, sign in (
        ("lower", tube.inputs, -1.0),
        ("upper", tube.inputs, 1.0),
        ("step_lower", tube.rates, -1.0),
        ("step_upper", tube.rates, 1.0),
    ):
        np.testing.assert_allclose(getattr(bounds, edge) + sign * taken, getattr(whole, edge))
    # Every sum of nominal input and deviation is a command within the limits.
    for nominal in (bounds.lower, bounds.upper):
        for deviation in (-tube.inputs, tube.inputs):
            command = ALONG.feedforward - nominal - deviation
            assert np.all(command >= LIMITS.lower - 1e-12)
            assert np.all(command <= LIMITS.upper + 1e-12)


def test_the_reference_itself_is_within_the_tightened_bounds():
    bounds = ALONG.bounds
    assert np.all(bounds.lower <= 0.0)
    assert np.all(bounds.upper >= 0.0)
    assert np.all(bounds.step_lower <= 0.0)
    assert np.all(bounds.step_upper >= 0.0)
    assert np.all(ALONG.free_share > 0.0)


def test_the_true_vehicle_is_allowed_the_estimators_error_on_top():
    width = ALONG.half_widths - np.concatenate(
        [ALONG.tube.states, ALONG.tube.outputs[:, 2:]], axis=1
    )
    np.testing.assert_allclose(width[:, :7], np.tile(np.diag(DESIGN.estimate_error.axes), (690, 1)))
    assert np.all(width[:, 7:] > 0.0)


def test_another_vehicle_or_period_is_refused_with_the_numbers():
    other = Reference(
        REFERENCE.path, replace(VEHICLE, wheelbase=1.5, drawbar_length=0.7), ConstantSpeed(1.0)
    )
    with pytest.raises(InvalidTube, match=r"wheelbase 1\.4 \(here 1\.5\), drawbar_length 0\.8"):
        along(reference=other)
    with pytest.raises(InvalidTube, match=r"period_s 0\.2 \(here 0\.1\)"):
        DESIGN.require(VEHICLE, 0.1)


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (6.0, r"tightened set is empty: .* s into the reference the tube takes \+-.* deg of the "),
        (200.0, r"tightened set is empty: .* m/s of a speed of 1\.00 m/s"),
    ],
)
def test_a_disturbance_beyond_the_inputs_is_refused_with_the_numbers(scale, message):
    with pytest.raises(InvalidTube, match=message):
        along(replace(DESIGN, disturbance=replace(WINDOW, axes=scale * WINDOW.axes)))


def test_at_a_stationary_motion_the_gain_is_the_stationary_one():
    system = ALONG.tube.system
    a, b, c = (
        np.repeat(matrices[20:21], 50, axis=0) for matrices in (system.a, system.b, system.c)
    )
    gains = gain_schedule(a, b, c, WEIGHTS)
    np.testing.assert_allclose(gains, np.repeat(gains[:1], 50, axis=0), atol=1e-8)
    cost = np.diag([0.0, 0.0, *WEIGHTS.states]) + (c[0].T * WEIGHTS.outputs) @ c[0]
    value = solve_discrete_are(a[0], b[0], cost, np.diag(WEIGHTS.inputs))
    exact = -np.linalg.solve(np.diag(WEIGHTS.inputs) + b[0].T @ value @ b[0], b[0].T @ value @ a[0])
    np.testing.assert_allclose(gains[0], exact, atol=1e-8)


def test_the_search_narrows_the_tube_and_leaves_the_reserve(monkeypatch):
    monkeypatch.setattr("ttempc.tube.reference_tube._EVALUATIONS", 60)
    system = ALONG.tube.system
    a, b, c = system.a[MOTIONS], system.b[MOTIONS], system.c[MOTIONS]
    margin = InputMargin.of(ALONG.feedforward[MOTIONS], LIMITS)
    reserve = 0.2 * np.array([VEHICLE.steering_limit_t, VEHICLE.steering_limit_i, 0.0])

    def cross_track(weights):
        gains = np.concatenate(
            [gain_schedule(a[[k]], b[[k]], c[[k]], weights) for k in range(len(MOTIONS))]
        )
        tube = invariant_tube(TrackingSystem(a, b, c, gains, np.arange(2)), WINDOW)
        return tube.outputs[:, [1, 3]].max(), tube

    start = replace(WEIGHTS, inputs=(5.0, 5.0, 5.0))
    weights = search_weights(a, b, c, WINDOW, margin, reserve, start)
    (before, _), (after, tube) = cross_track(start), cross_track(weights)
    assert after < 0.9 * before
    assert np.all(tube.inputs <= margin.amplitudes - reserve)
    assert np.all(tube.inputs[:, Input.HP] <= margin.amplitudes[:, Input.HP])
