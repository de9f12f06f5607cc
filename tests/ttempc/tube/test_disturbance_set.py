"""Sets of disturbances that are bounded over windows of steps."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from tests.reference.ttempc.zonotope import Zonotope
from tests.ttempc.tubes import admissible
from ttempc.errors import InvalidTube
from ttempc.tube.sets import DisturbanceSet

AXES = np.random.default_rng(5).standard_normal((3, 3))


@pytest.fixture
def generator():
    return np.random.default_rng(6)


def test_one_step_sets_are_zonotope_and_ellipsoid(generator):
    w = generator.standard_normal((50, 3))
    a = generator.standard_normal((50, 3))
    zonotope, ellipsoid = DisturbanceSet(AXES), DisturbanceSet(AXES, shape="ellipsoid")
    as_generators = Zonotope(np.zeros(3), AXES)
    np.testing.assert_allclose(zonotope.fill(w), [as_generators.gauge(row) for row in w], rtol=1e-6)
    np.testing.assert_allclose(zonotope.support(a), as_generators.support(a))
    shape = AXES @ AXES.T
    np.testing.assert_allclose(
        ellipsoid.fill(w), np.sqrt((w * np.linalg.solve(shape, w.T).T).sum(axis=1))
    )
    np.testing.assert_allclose(ellipsoid.support(a), np.sqrt((a * (a @ shape)).sum(axis=1)))


@pytest.mark.parametrize("shape", ["zonotope", "ellipsoid"])
@pytest.mark.parametrize("window", [1, 4])
def test_reach_bounds_every_window_and_the_worst_one_attains_it(shape, window, generator):
    disturbance = DisturbanceSet(AXES, window, shape)
    coefficients = generator.standard_normal((window, 3))
    bound = disturbance.reach(((coefficients @ AXES) ** 2).sum(axis=0))
    for _ in range(200):
        run = admissible(disturbance, window, generator)
        assert (coefficients * run).sum() <= bound + 1e-12
    worst = disturbance.worst(coefficients)
    assert disturbance.fill(worst)[0] == pytest.approx(1.0)
    assert (coefficients * worst).sum() == pytest.approx(bound)


@pytest.mark.parametrize("shape", ["zonotope", "ellipsoid"])
def test_the_worst_long_run_is_admissible_and_nearly_the_largest(shape, generator):
    """A general solver of convex programmes reaches no more than 1 % above it."""
    disturbance = DisturbanceSet(np.eye(2), 3, shape)
    coefficients = generator.standard_normal((9, 2))
    run = disturbance.worst(coefficients)
    assert disturbance.fill(run).max() == pytest.approx(1.0)

    def spare(flat):
        squares = flat.reshape(9, 2) ** 2
        sums = np.array([squares[k : k + 3].sum(axis=0) for k in range(7)])
        return (1.0 - (sums.sum(axis=1) if shape == "ellipsoid" else sums)).ravel()

    best = minimize(
        lambda flat: -(coefficients.ravel() @ flat),
        0.1 * coefficients.ravel(),
        jac=lambda flat: -coefficients.ravel(),
        constraints={"type": "ineq", "fun": spare},
        method="SLSQP",
    )
    assert best.success
    assert 0.99 * -best.fun <= (coefficients * run).sum() <= -best.fun * (1.0 + 1e-6)


@pytest.mark.parametrize("shape", ["zonotope", "ellipsoid"])
def test_disturbances_within_the_faces_are_inside(shape, generator):
    disturbance = DisturbanceSet(AXES, 4, shape)
    faces, inner = disturbance.faces
    inside = np.linalg.solve(faces, inner * generator.uniform(-1.0, 1.0, (3, 200))).T
    for w in inside:
        assert disturbance.fill(np.vstack([w, np.zeros((3, 3))]))[0] <= 1.0 + 1e-12


def test_a_window_bounds_white_noise_more_tightly_than_its_steps(generator):
    run = generator.standard_normal((200_000, 1))
    reach = {}
    for n in (1, 5):
        radius = np.quantile(DisturbanceSet(np.eye(1), n).fill(run), 0.999)
        reach[n] = 5.0 / n * radius * np.sqrt(n)  # what five steps can add up to
        constant = DisturbanceSet(np.array([[radius]]), n).reach(np.array([n * radius**2]))
        assert 5.0 / n * constant == pytest.approx(reach[n])
    ratio = reach[5] / reach[1]
    assert ratio == pytest.approx(0.62, abs=0.01)


@pytest.mark.parametrize(
    ("axes", "window"), [(np.zeros((2, 2)), 1), (np.ones((2, 3)), 1), (np.eye(2), 0)]
)
def test_sets_that_bound_nothing_are_refused(axes, window):
    with pytest.raises(InvalidTube, match="must be"):
        DisturbanceSet(axes, window)
