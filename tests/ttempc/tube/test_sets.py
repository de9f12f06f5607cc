"""Sets given by their support functions: laws, disturbance sets, conformal calibration."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from scipy.stats import beta, kstest

from tests.reference.ttempc.zonotope import Zonotope
from tests.ttempc.tubes import admissible
from ttempc.errors import InvalidTube
from ttempc.tube.conformal import calibrate, fewest_scores, largest_score
from ttempc.tube.sets import DisturbanceSet, linear_map, minkowski_sum, outline


@pytest.fixture
def generator():
    return np.random.default_rng(3)


def random_zonotope(generator, dimension, generators):
    centre = generator.standard_normal(dimension)
    return Zonotope(centre, generator.standard_normal((dimension, generators)))


def test_sums_and_maps_hold_what_samples_add_up_to_and_reach_it(generator):
    first = random_zonotope(generator, 4, 5)
    second = random_zonotope(generator, 4, 3)
    matrix = generator.normal(size=(3, 4))
    total = linear_map(matrix, minkowski_sum([first, second]))
    points = (first.vertices()[:, None] + second.vertices()).reshape(-1, 4)
    directions = generator.standard_normal((50, 3))
    exact = (directions @ matrix @ points.T).max(axis=1)
    np.testing.assert_allclose(total.support(directions), exact, atol=1e-12)


@pytest.mark.parametrize(("seed", "stretch"), [(0, 1.0), (1, 1.0), (2, 100.0), (3, 100.0)])
def test_outline_contains_the_projection_and_approaches_it(seed, stretch):
    """A vertex is at most D / 2 tan(pi / count) away, D the diameter, for any shape."""
    generator = np.random.default_rng(seed)
    zonotope = random_zonotope(generator, 5, 8)
    plane = generator.standard_normal((2, 5)) * [[stretch], [1.0]]
    points = zonotope.vertices() @ plane.T
    diameter = pdist(points).max()
    turns = np.linspace(0.0, 2.0 * np.pi, 2000)
    normals = np.column_stack([np.cos(turns), np.sin(turns)])
    reach = (normals @ points.T).max(axis=1)
    for count in (8, 24, 90, 360):
        beyond = (normals @ outline(zonotope, plane, count).T).max(axis=1) - reach
        assert beyond.min() >= -1e-9 * diameter
        assert beyond.max() <= 0.5 * diameter * math.tan(math.pi / count)


AXES = np.random.default_rng(5).standard_normal((3, 3))


def test_one_step_sets_are_zonotopes(generator):
    steps = generator.standard_normal((50, 3))
    directions = generator.standard_normal((50, 3))
    one_step = DisturbanceSet(AXES)
    gauge = np.abs(np.linalg.solve(AXES, steps.T)).max(axis=0)
    np.testing.assert_allclose(one_step.fill(steps), gauge)
    exact = Zonotope(np.zeros(3), AXES).support(directions)
    np.testing.assert_allclose(one_step.support(directions), exact)


@pytest.mark.parametrize("window", [1, 4])
def test_reach_bounds_every_window_and_the_worst_one_attains_it(window, generator):
    disturbance = DisturbanceSet(AXES, window)
    coefficients = generator.standard_normal((window, 3))
    bound = disturbance.reach(((coefficients @ AXES) ** 2).sum(axis=0))
    for _ in range(200):
        run = admissible(disturbance, window, generator)
        assert (coefficients * run).sum() <= bound + 1e-12
    worst = disturbance.worst(coefficients)
    assert disturbance.fill(worst)[0] == pytest.approx(1.0)
    assert (coefficients * worst).sum() == pytest.approx(bound)


@pytest.mark.parametrize(
    ("axes", "window"), [(np.zeros((2, 2)), 1), (np.ones((2, 3)), 1), (np.eye(2), 0)]
)
def test_sets_that_bound_nothing_are_refused(axes, window):
    with pytest.raises(InvalidTube, match="must be"):
        DisturbanceSet(axes, window)


@pytest.mark.parametrize(("count", "coverage"), [(19, 0.95), (40, 0.95), (30, 0.5), (7, 0.8)])
def test_the_coverage_given_a_calibration_has_a_beta_distribution(count, coverage, generator):
    """Of uniform scores, the coverage of a calibration is its factor itself."""
    drawn = [calibrate(scores, coverage) for scores in generator.uniform(size=(2000, count))]
    rank = drawn[0].rank
    factors = [one.factor for one in drawn]
    assert kstest(factors, beta(rank, count + 1 - rank).cdf).pvalue > 0.01
    assert coverage <= drawn[0].coverage < coverage + 1.0 / (count + 1)
    low, high = drawn[0].coverage_interval(0.9)
    assert np.mean([low <= factor <= high for factor in factors]) == pytest.approx(0.9, abs=0.02)


def test_the_next_run_is_inside_as_often_as_promised_whatever_the_distribution(generator):
    """Heavy-tailed random walks, each of a heavy-tailed size of its own."""
    inside = []
    for _ in range(400):
        size = generator.pareto(1.5, (30, 1, 1)) + 0.1
        walks = np.cumsum(size * generator.standard_t(3, (30, 40, 2)), axis=1)
        *scores, fresh = [largest_score(walk, np.array([1.0, 2.0])) for walk in walks]
        calibration = calibrate(scores, 0.9)
        inside.append(fresh <= calibration.factor)
    assert calibration.coverage == 0.9
    assert np.mean(inside) == pytest.approx(0.9, abs=0.045)  # three standard deviations


def test_bad_or_too_few_scores_and_scales_are_refused():
    for coverage in (0.5, 0.6, 0.95, 0.999):
        fewest = fewest_scores(coverage)
        assert calibrate(np.arange(fewest), coverage).rank == fewest
        if fewest > 1:
            with pytest.raises(InvalidTube, match=rf"got {fewest - 1} scores"):
                calibrate(np.arange(fewest - 1), coverage)
    with pytest.raises(InvalidTube, match="not NaN"):
        calibrate([1.0, np.nan], 0.5)
    with pytest.raises(InvalidTube, match=r"scale: .* must be above 0"):
        largest_score(np.ones((3, 2)), np.array([1.0, 0.0]))
    with pytest.raises(InvalidTube, match="must be finite and not empty"):
        largest_score(np.array([[np.nan]]), np.array([1.0]))
