"""Search for eight published errors: parameters, distances, search, table."""

from __future__ import annotations

import numpy as np
import pytest
from proving_ground.experiments.papers.kayacan import eight_numbers as module
from proving_ground.experiments.papers.kayacan.eight_numbers import ALL, FIELD
from proving_ground.experiments.run.assembly import check
from proving_ground.experiments.scenario.scenario import load


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
    lines = module.overrides(FIELD, [0.0, 0.5, 0.5])
    assert lines == ('terrain.iso_class="C"', "soil.cone_index_kpa=268.0", "terrain.slope_rad=0.05")


def test_distance_is_zero_at_the_published_and_the_worst_where_lost():
    published = module.PUBLISHED_CM
    assert module.distance(published) == 0.0
    assert module.distance(1.1 * published) == pytest.approx(0.1)
    assert module.distance(np.full(8, np.nan)) == module.WORST


def test_a_search_comes_nearer_with_every_generation_and_its_table_names_what_is_beyond(
    monkeypatch,
):
    goal = np.linspace(0.2, 0.8, len(ALL))

    def errors_cm(problem, runner, points, seeds):
        """Return the published errors times 1 and the squared distance from a point."""
        away = np.array([np.sum((point - goal) ** 2) for point in points])
        return (
            np.ones((1, len(seeds), 1))
            * np.multiply.outer(1.0 + away, module.PUBLISHED_CM)[:, None]
        )

    monkeypatch.setattr(module.Problem, "errors_cm", errors_cm)
    few, many = (module.find(module.BOTH, None, generations) for generations in (3, 30))
    assert len(few.tried_cm) == 3 * module.SETS
    np.testing.assert_array_equal(many.tried_cm[: len(few.tried_cm)], few.tried_cm)
    assert module.distance(many.mean_cm) < 0.7 * module.distance(few.mean_cm)
    report_cm = np.ones((5, 1)) * module.PUBLISHED_CM
    report_cm[:, 6] *= 0.5
    report_cm[0, 4:] = np.nan
    found = module.Found(module.BOTH, report_cm[1:3] * [[1.0], [2.0]], few.point, report_cm)
    text = module.search_table(found)
    assert "1 of 5 with a lost run. Beyond 25%: NMPC, tractor curve." in text
    assert "| 1 of 2 |" in text
