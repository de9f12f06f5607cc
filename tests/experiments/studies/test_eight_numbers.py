"""Study of the eight numbers: search, parameters, kept runs, tables."""

from __future__ import annotations

import numpy as np
import pytest
from proving_ground.experiments.run.assembly import check
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.studies.batch import BatchSettings, StudyRun, batch_settings
from proving_ground.experiments.studies.eight_numbers import __main__, runs, study, tables
from proving_ground.experiments.studies.eight_numbers.parameters import (
    ALL,
    FIELD,
    LMPC,
    NMPC,
    overrides,
)
from proving_ground.experiments.studies.eight_numbers.runs import RunStore
from proving_ground.experiments.studies.eight_numbers.search import START, Trial, best, search
from proving_ground.experiments.studies.eight_numbers.tables import search_table, verdict
from proving_ground.experiments.sweep.engine import engine

STRAIGHT = 'path={kind="straight",length_m=10.0}'
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


@pytest.mark.parametrize("place", [0.0, 0.5, 1.0])
def test_every_corner_of_the_bounds_can_be_driven(place):
    """Nothing within the stated bounds is refused as a scenario."""
    for problem in (study.BOTH, study.LMPC_ON_FIELD):
        point = np.full(len(problem.parameters), place)
        for run in problem.runs(point, 1, study.ONE_LAP):
            assert check(load(run.scenario, run.overrides)[1]) > 500


def test_parameters_span_their_bounds():
    for item in ALL:
        ends = item.value(0.0), item.value(1.0)
        assert ends == ((item.choices[0], item.choices[-1]) if item.choices else ends)
        if not item.choices:
            np.testing.assert_allclose(np.array(ends, dtype=float), [item.low, item.high])
        value = item.value(0.6)
        assert item.value(item.share(value)) == value
    lines = overrides(FIELD, np.array([0.0, 0.5, 0.5]))
    assert lines == ('terrain.iso_class="C"', "soil.cone_index_kpa=268.0", "terrain.slope_rad=0.05")


def test_distance_is_zero_at_the_published_and_the_worst_where_lost():
    assert study.distance(study.PUBLISHED_CM, study.PUBLISHED_CM) == 0.0
    assert study.distance(1.1 * study.PUBLISHED_CM, study.PUBLISHED_CM) == pytest.approx(0.1)
    lost = np.full(8, np.nan)
    assert study.distance(lost, study.PUBLISHED_CM) == study.WORST


def found(report_cm):
    points = np.full((2, len(ALL)), 0.5)
    return study.Found(
        problem=study.BOTH,
        trials=[Trial(point, 1.0) for point in points],
        trial_errors_cm=np.array([study.PUBLISHED_CM, 2.0 * study.PUBLISHED_CM]),
        point=points[0],
        tuning_cm=study.PUBLISHED_CM,
        report_cm=report_cm,
    )


def test_verdict_names_what_is_beyond_a_quarter():
    seeds = np.ones((5, 1))
    assert verdict(found(1.2 * seeds * study.PUBLISHED_CM)).startswith("Found within 25% each")
    off = seeds * study.PUBLISHED_CM
    off[:, 6] *= 0.5
    text = verdict(found(off))
    assert text.startswith("No set found in 2 evaluations")
    assert "NMPC, tractor curve (0.50 times the published)" in text
    assert "LMPC" not in text
    lost = seeds * study.PUBLISHED_CM
    lost[0, 4:] = np.nan
    assert "1 of 5 with a lost run" in verdict(found(lost))
    assert "| 1 of 2 |" in search_table(found(off))


def test_a_run_is_driven_once(monkeypatch):
    driven = []

    def drive(run):
        driven.append(run)
        return [1.0, 2.0, np.nan, np.nan] if run.seed == 1 else runs._LOST

    monkeypatch.setattr(runs, "_drive", drive)
    wanted = [StudyRun("grass", seed) for seed in (1, 2, 1)]
    with engine(0) as workers:
        store = RunStore(workers)
        for _ in range(2):
            errors = store.errors_cm(wanted)
    np.testing.assert_array_equal(errors[0], [1.0, 2.0, np.nan, np.nan])
    assert np.isnan(errors[1]).all()
    assert len(driven) == 2


def test_study_prints_its_tables(capsys, monkeypatch):
    monkeypatch.setattr(study, "TUNING_SEEDS", (1,))
    monkeypatch.setattr(study, "REPORT_SEEDS", (2,))
    controllers = ((LMPC, slice(None)), (NMPC, slice(None)))
    both = study.Problem(FIELD, controllers, study.PUBLISHED_CM)
    monkeypatch.setattr(tables, "BOTH", both)
    with batch_settings(BatchSettings(0)):
        tables.print_tables("all", budget=1, fit_budget=1, path=(STRAIGHT,))
    text = capsys.readouterr().out
    assert text.count("LMPC, tractor straight | 23.49") == 2
    assert "No set found in 1 evaluations" in text
    assert all(f"| {item.name} | {item.bounds} |" in text for item in FIELD)


def test_a_budget_below_one_is_refused(capsys):
    with pytest.raises(SystemExit) as refusal:
        __main__.main(["search", "--budget", "0"])
    assert refusal.value.code == 2
    assert "--budget: got 0, must be 1 or more" in capsys.readouterr().err
