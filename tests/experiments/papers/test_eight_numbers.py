"""Search for eight published errors: search, parameters, distances, verdict."""

from __future__ import annotations

import numpy as np
import pytest
from proving_ground.experiments.papers.kayacan import eight_numbers as module
from proving_ground.experiments.papers.kayacan.eight_numbers import ALL, FIELD, START, best, search
from proving_ground.experiments.run.assembly import check
from proving_ground.experiments.scenario.scenario import load

CENTRE = np.array([0.3, 0.7, 0.9, 0.1])


def bowl(points):
    return [float(np.sum((point - CENTRE) ** 2)) for point in points]


def test_search_goes_below_the_best_of_as_many_points_of_its_first_sequence():
    trials = search(bowl, 4, 256)
    first = min(trial.score for trial in trials[:START])
    assert best(trials, 1)[0].score < 0.1 * first
    assert all(np.all((trial.point >= 0.0) & (trial.point <= 1.0)) for trial in trials)


def test_a_larger_budget_continues_a_smaller_one():
    small, large = (search(bowl, 4, budget) for budget in (75, 90))
    for mine, theirs in zip(small, large, strict=False):
        np.testing.assert_array_equal(mine.point, theirs.point)


def test_every_corner_of_the_bounds_can_be_driven():
    """Nothing within the stated bounds is refused as a scenario."""
    for problem in (module.BOTH, module.LMPC_ON_FIELD):
        for place in (0.0, 0.5, 1.0):
            for case in problem.cases(np.full(len(problem.parameters), place), 1):
                assert check(load(case.scenario, case.overrides)[1]) > 500


def test_parameters_span_their_bounds():
    for item in ALL:
        ends = item.value(0.0), item.value(1.0)
        assert ends == ((item.choices[0], item.choices[-1]) if item.choices else ends)
        if not item.choices:
            np.testing.assert_allclose(np.array(ends, dtype=float), [item.low, item.high])
        for value in (item.value(0.6), item.start):
            assert item.value(item.share(value)) == value
    lines = module.overrides(FIELD, np.array([0.0, 0.5, 0.5]))
    assert lines == ('terrain.iso_class="C"', "soil.cone_index_kpa=268.0", "terrain.slope_rad=0.05")


def test_distance_is_zero_at_the_published_and_the_worst_where_lost():
    published = module.PUBLISHED_CM
    assert module.distance(published, published) == 0.0
    assert module.distance(1.1 * published, published) == pytest.approx(0.1)
    assert module.distance(np.full(8, np.nan), published) == module.WORST


def test_verdict_names_what_is_beyond_a_quarter():
    def found(report_cm):
        points = np.full((2, len(ALL)), 0.5)
        return module.Found(
            problem=module.BOTH,
            trials=[module.Trial(point, 1.0) for point in points],
            trial_errors_cm=np.array([module.PUBLISHED_CM, 2.0 * module.PUBLISHED_CM]),
            point=points[0],
            tuning_cm=module.PUBLISHED_CM,
            report_cm=report_cm,
        )

    seeds = np.ones((5, 1))
    assert module.verdict(found(1.2 * seeds * module.PUBLISHED_CM)).startswith("Found within 25%")
    off = seeds * module.PUBLISHED_CM
    off[:, 6] *= 0.5
    text = module.verdict(found(off))
    assert "NMPC, tractor curve (0.50 times" in text
    assert "LMPC" not in text
    assert "| 1 of 2 |" in module.search_table(found(off))
    lost = seeds * module.PUBLISHED_CM
    lost[0, 4:] = np.nan
    assert "1 of 5 with a lost run" in module.verdict(found(lost))
