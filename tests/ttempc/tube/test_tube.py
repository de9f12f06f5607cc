"""Invariance of tubes: in closed form, in dense directions, and by trajectories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.tubes import DESIGN, STEP, TICKS, WINDOW, admissible, along
from ttempc.errors import InvalidTube
from ttempc.tube.sets import DisturbanceSet, directions_in, linear_map, minkowski_sum
from ttempc.tube.tube import TrackingSystem, Tube, invariant_tube

TUBES = {
    "window": along().tube,
    "box": along(replace(DESIGN, disturbance=STEP)).tube,
    "ellipsoid": along(
        replace(DESIGN, disturbance=replace(WINDOW, axes=1.2 * WINDOW.axes, shape="ellipsoid"))
    ).tube,
}


@pytest.fixture
def generator():
    return np.random.default_rng(7)


def unchanging(a, b=None, gains=None):
    n = len(a)
    b = np.zeros((n, 1)) if b is None else b
    gains = np.zeros((1, n)) if gains is None else gains
    return TrackingSystem(a[None], b[None], np.eye(n)[None], gains[None], np.zeros(1, dtype=int))


def test_a_first_order_lag_has_the_geometric_series_as_its_set():
    for pole in (0.0, 0.5, 0.9, -0.7):
        tube = invariant_tube(
            unchanging(np.array([[pole]])), DisturbanceSet(np.array([[2.0]])), 1e-3
        )
        exact = 2.0 / (1.0 - abs(pole))
        assert exact <= tube.states[0, 0] * (1.0 + 1e-12)
        assert (1.0 - tube.certificate.alpha) * tube.states[0, 0] <= exact * (1.0 + 1e-12)


def test_with_windows_of_one_step_it_is_the_set_of_rakovic(generator):
    a = np.array([[0.9, 0.2], [-0.1, 0.7]])
    axes = np.array([[0.1, 0.05], [0.0, 0.2]])
    tube = invariant_tube(unchanging(a), DisturbanceSet(axes), 0.05)
    terms = tube.certificate.terms
    powers = [np.linalg.matrix_power(a, i) @ axes for i in range(terms + 1)]
    alpha = np.abs(np.linalg.solve(axes, powers[terms])).sum(axis=1).max()
    assert tube.certificate.alpha == pytest.approx(alpha)
    directions = directions_in(2, 50, generator)
    by_hand = np.abs(directions @ np.hstack(powers[:-1])).sum(axis=1) / (1.0 - alpha)
    np.testing.assert_allclose(tube.at(0).support(directions), by_hand)


@pytest.mark.parametrize("name", TUBES)
def test_every_set_leads_into_the_set_a_window_later(name, generator):
    """Phi S_k + V inside S_{k+N}, in 1000 directions at ticks all along the figure eight."""
    tube = TUBES[name]
    window = tube.certificate.window
    for k in range(window, TICKS, 61):
        directions = directions_in(7, 1000, generator) / tube.states[k]
        before = linear_map(tube.transition(k, window), tube.at(k - window))
        after = minkowski_sum([before, tube.last_window(k)])
        assert np.all(after.support(directions) <= tube.at(k).support(directions) + 1e-9)


def driven(tube: Tube, last: int, disturbances):
    """Return the deviation at every tick up to `last` from 0, (steps + 1, 7) for (steps, 7)."""
    m = np.zeros((len(disturbances) + 1, *disturbances.shape[1:]))
    for step, w in enumerate(disturbances):
        k = max(0, last - len(disturbances) + step)
        m[step + 1] = m[step] @ tube.system.closed[k].T + w
    return m


@pytest.mark.parametrize("name", TUBES)
def test_no_trajectory_leaves_and_the_worst_ones_reach_the_boundary(name, generator):
    """20 random runs over a lap, each step counted; worst cases for states, outputs, inputs."""
    tube = TUBES[name]
    for _ in range(20):
        run = admissible(tube.disturbance, TICKS - 1, generator)
        m = driven(tube, TICKS - 1, run)
        assert np.all(np.abs(m) <= tube.states * (1.0 + 1e-12))
        output = np.abs(np.einsum("kij,kj->ki", tube.system.c, m))
        u = np.einsum("kij,kj->ki", tube.system.gains, m)
        assert np.all(output <= tube.outputs * (1.0 + 1e-12))
        assert np.all(np.abs(u) <= tube.inputs * (1.0 + 1e-12))
        assert np.all(np.abs(np.diff(u, axis=0)) <= tube.rates[1:] * (1.0 + 1e-12))
    k = 300
    rows = np.concatenate([np.eye(7), tube.system.c[k], tube.system.gains[k]])
    bounds = np.concatenate([tube.states[k], tube.outputs[k], tube.inputs[k]])
    for row, bound in zip(rows, bounds, strict=True):
        run = tube.worst_case(k, row)
        assert tube.disturbance.fill(run).max() == pytest.approx(1.0)
        share = row @ driven(tube, k, run)[-1] / (bound * (1.0 - tube.certificate.alpha))
        if tube.certificate.window == 1:
            assert share == pytest.approx(1.0)
        else:
            assert 0.92 < share < 1.0


def test_curves_are_not_straights():
    tube = TUBES["window"]
    straight, curve = tube.outputs[20], tube.outputs[120]
    assert not np.allclose(straight, curve, rtol=0.01)


def test_halving_the_disturbance_halves_the_tube():
    half = along(replace(DESIGN, disturbance=replace(WINDOW, axes=0.5 * WINDOW.axes))).tube
    np.testing.assert_allclose(half.outputs, 0.5 * TUBES["window"].outputs)
    assert half.certificate == TUBES["window"].certificate


def test_what_does_not_contract_is_refused_with_its_growth():
    for pole in (1.0, 1.5):
        with pytest.raises(InvalidTube, match=rf"does not contract: .* modulus {pole:.4f}"):
            invariant_tube(unchanging(np.array([[pole]])), DisturbanceSet(np.eye(1)))
