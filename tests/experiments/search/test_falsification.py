"""Falsification of analytic limit states: the least severe failure, order of cases, budget."""

import itertools

import numpy as np
import pytest
from proving_ground.experiments.search.falsification import Case, best, distinct, falsify, milder
from proving_ground.experiments.search.robustness import Outcome
from proving_ground.experiments.search.space import Parameter, Space

SPACE = Space(
    (
        Parameter(keys=("force",), low=0.0, high=1.0, nominal=0.0),
        Parameter(keys=("delay",), low=0.0, high=1.0, nominal=0.0),
        Parameter(keys=("place",), low=0.0, high=1.0, nominal=None),
    )
)


def distance(point):
    """Return how far a point is from failure: a half plane of the severities, near one place."""
    force, delay, place = point
    return 0.6 + abs(place - 0.7) - (force + delay) / 2.0


def evaluate(points):
    distances = [distance(point) for point in points]
    return [
        Outcome(d <= 0.0, min(max(d, 0.0), 1.0), "it fails" if d <= 0.0 else "") for d in distances
    ]


def search(budget=150, seed=1, outcomes=evaluate):
    return falsify(SPACE, outcomes, budget, seed)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_least_severe_failure_is_found(seed):
    """By symmetry it lies at force = delay = 0.6, place = 0.7, with severity 0.6."""
    case = best(search(seed=seed))
    assert case.failed
    assert 0.6 - 1e-9 <= case.severity <= 0.66
    assert case.point == pytest.approx([0.6, 0.6, 0.7], abs=0.15)


def test_the_search_beats_random_points_of_the_same_budget():
    rng = np.random.default_rng(1)
    random = []
    for _ in range(20):
        points = rng.random((100, 3))
        pairs = zip(points, evaluate(points), strict=True)
        random.append(best([Case(p, SPACE.severity(p), o) for p, o in pairs]).cost)
    assert np.mean([best(search(100, seed)).cost for seed in range(5)]) < np.mean(random) - 0.05


def test_the_cases_follow_from_the_seed_and_the_budget_is_kept():
    for budget in (1, 10, 37, 150):
        cases = search(budget)
        assert len(cases) == budget
        again = search(budget)
        assert all((a.point == b.point).all() for a, b in zip(cases, again, strict=True))
    assert any((a.point != b.point).any() for a, b in zip(cases, search(seed=2), strict=True))


def test_without_a_failure_the_least_robust_case_is_best():
    def never(points):
        return [Outcome(False, 0.2 + 0.8 * abs(place - 0.7)) for *_, place in points]

    cases = search(60, outcomes=never)
    assert not any(case.failed for case in cases)
    assert best(cases).point[2] == pytest.approx(0.7, abs=0.05)
    assert distinct(SPACE, cases, 3) == []


def test_where_a_place_alone_fails_the_severity_goes_to_0():
    def by_place(points):
        return [Outcome(place > 0.5, float(place <= 0.5)) for *_, place in points]

    assert best(search(60, outcomes=by_place)).severity < 0.01


def test_refused_points_are_no_failures():
    def mostly_refused(points):
        pairs = zip(points, evaluate(points), strict=True)
        return [None if point[0] > 0.5 else outcome for point, outcome in pairs]

    case = best(search(outcomes=mostly_refused))
    assert case.failed
    assert case.point[0] <= 0.5


def test_distinct_failures_are_ordered_and_apart():
    cases = search()
    chosen = distinct(SPACE, cases, 3)
    assert chosen[0] is best(cases)
    severities = [case.severity for case in chosen]
    assert severities == sorted(severities)
    for case, other in itertools.pairwise(chosen):
        assert np.linalg.norm(case.point - other.point) >= 0.2 * np.sqrt(3)


def test_milder_points_are_milder_and_at_the_same_place():
    point = np.array([0.9, 0.5, 0.3])
    severities = [SPACE.severity(other) for other in milder(SPACE, point)]
    assert max(severities) < SPACE.severity(point)
    assert (milder(SPACE, point)[:, 2] == 0.3).all()
    assert milder(SPACE, point)[:2] == pytest.approx(np.array([[0.0, 0.5, 0.3], [0.9, 0.0, 0.3]]))


def test_a_deviation_that_is_not_needed_is_dropped():
    """Only the force matters: the delay of the least severe failure is nominal."""

    def by_force(points):
        return [Outcome(force >= 0.5, float(force < 0.5)) for force, *_ in points]

    case = best(search(60, outcomes=by_force))
    assert case.point[1] == 0.0
    assert 0.5 <= case.point[0] < 0.53
