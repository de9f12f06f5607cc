"""Half widths of whole laps: closed forms of their two estimates, and the counts of fresh laps."""

import numpy as np
import pytest
from proving_ground.experiments.results.summary import Summary
from proving_ground.experiments.seeds import FITTING, report_seeds
from proving_ground.experiments.studies.ablations import coverage
from proving_ground.experiments.studies.batch import StudyRun, simulate_run
from scipy.stats import gumbel_r


def draws(count, seed):
    generator = np.random.default_rng(seed)
    return gumbel_r.rvs([0.05, 0.04], [0.006, 0.003], size=(count, 2), random_state=generator)


def test_the_extrapolation_is_the_quantile_of_the_distribution():
    expected = np.array([0.05, 0.04]) - np.array([0.006, 0.003]) * np.log(-np.log(0.999))
    assert coverage.extrapolated(draws(4000, 1)) == pytest.approx(expected, rel=0.02)


def test_fresh_laps_keep_to_the_half_widths_as_often_as_promised():
    cells = [
        coverage.line("grass", draws(40, seed), draws(400, 100 + seed)).split("|")
        for seed in range(20)
    ]
    inside = np.array([[int(row[n].split(" of ")[0]) for n in (4, 6)] for row in cells])
    promised = float(cells[0][3].strip(" %"))
    assert promised >= 95.0
    # The promise is a mean over calibrations; its standard error here is below 1 %.
    assert promised - 3.0 < 100.0 * inside[:, 0].mean() / 400 < promised + 3.0
    assert inside[:, 1].mean() / 400 > 0.98


def test_a_lap_that_ends_early_is_outside():
    fresh = np.vstack([draws(9, 3), [np.inf, np.inf]])
    row = coverage.line("grass", draws(40, 2), fresh)
    assert " 9 of 10 " in row.split("|")[6]


def test_the_judge_does_not_change_the_lap():
    short = 'path={kind="straight",length_m=15.0}'

    def summary(*overrides: str) -> Summary:
        return simulate_run(StudyRun("grass", 1, (*overrides, short)))

    judged, plain = summary(*coverage.JUDGED[1:]), summary()
    assert judged.tracking == plain.tracking
    assert judged.corridor is not None
    assert plain.corridor is None


def test_fresh_laps_are_not_those_of_the_calibration():
    fitted = set(FITTING[: coverage.CALIBRATION_LAPS])
    assert not fitted & set(report_seeds(coverage.LAPS))
