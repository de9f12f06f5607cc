"""Weights near the trailer's stop: where they change, how smoothly, and in a horizon."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.horizons import TUNING, stages
from ttempc import Reference, Vehicle, figure_eight
from ttempc.laws.near_stop import weight_factors
from ttempc.mpc.articulated_error import Output
from ttempc.mpc.lmpc import CondensedHorizon, LinearMpc
from ttempc.reference.reference import ConstantSpeed
from ttempc.types import State

PERIOD_S = 0.2
PATH = figure_eight(8.0, blend_m=4.0, laps=1)


def along(vehicle, ticks=500):
    reference = Reference(PATH, vehicle, ConstantSpeed(1.0))
    angle = np.abs(reference.at(PERIOD_S * np.arange(ticks)).state[:, State.DELTA_I])
    return weight_factors(reference, ticks, PERIOD_S)[:, Output.TRACTOR_ACROSS], angle


def with_stop_at(share):
    """Return a vehicle for which the circles of the path need a share of the trailer's stop."""
    _, angle = along(Vehicle())
    return replace(Vehicle(), steering_limit_i=angle.max() / share)


def test_the_tractor_weighs_less_where_the_stop_is_near_and_before_it_alone():
    factor, angle = along(with_stop_at(0.99))
    near = angle > 0.97 * angle.max()
    assert near.any()
    np.testing.assert_allclose(factor[near], factor.min())
    assert 0.0 < factor.min() < 0.5
    first = int(np.argmax(near))
    assert (np.diff(factor[first - 15 : first]) <= 0.0).all()
    assert (factor[: first - 60] == 1.0).all()
    assert np.abs(np.diff(factor)).max() < 0.4  # no jump from tick to tick


def test_the_factor_is_continuous_in_the_stop():
    vehicles = [with_stop_at(share) for share in np.linspace(0.7, 1.0, 61)]
    least = np.array([along(vehicle)[0].min() for vehicle in vehicles])
    assert least[0] == 1.0
    assert (np.diff(least) <= 1e-12).all()
    assert np.abs(np.diff(least)).max() < 0.1


@pytest.mark.parametrize(
    "vehicle", [Vehicle(), Vehicle(steering_limit_i=0.0)], ids=["far from its stop", "plain"]
)
def test_other_vehicles_and_places_have_the_weights_as_given(vehicle):
    path = figure_eight(30.0, centre_distance_m=90.0)
    reference = Reference(path, vehicle, ConstantSpeed(1.0))
    assert (weight_factors(reference, 300, PERIOD_S) == 1.0).all()


def test_a_horizon_with_factors_is_that_of_scaled_outputs():
    """Weights q f of y cost what weights q of sqrt(f) y do, tick by tick."""
    a, b = stages()
    size = a.shape[2]
    generator = np.random.default_rng(3)
    factors = generator.uniform(0.2, 3.0, (len(a) + 1, size))
    scaled = np.sqrt(factors)[:, :, None] * np.eye(size)
    by_factors = LinearMpc(CondensedHorizon(a, b, TUNING, PERIOD_S, weight_factors=factors))
    by_outputs = LinearMpc(CondensedHorizon(a, b, TUNING, PERIOD_S, outputs=scaled))
    for k in (0, 3):
        error = 0.02 * generator.normal(size=size)
        previous = np.zeros(b.shape[2])
        first, _ = by_factors.step(k, error, previous)
        second, _ = by_outputs.step(k, error, previous)
        np.testing.assert_allclose(first, second, atol=1e-7)
        assert np.abs(first).max() > 1e-4
