"""Consistency of the filter on the plant: innovations are as large as their covariance says."""

import numpy as np
import pytest
from proving_ground.experiments.logs.replay import estimator_of, replay
from proving_ground.experiments.results.consistency import consistency
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import ESTIMATE
from proving_ground.testbed.recording.record import Recorder
from proving_ground.testbed.simulation.loop import drive
from scipy.stats import chi2

from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.noise import ProcessNoise
from ttempc.types import State
from ttempc.vehicle import Vehicle

STRAIGHT = 'path={kind="straight", length_m=30}'
SDS = ("gnss_sd_m", "angle_sd_deg", "encoder_sd_mps")
CAUTION = 0.03
"""Share by which the filter's innovation covariance may be too large.

The process noise is set for fields; on smooth firm ground the plant deviates less than it allows.
No such share is granted to the other side: a filter must not be overconfident.
"""


def innovations(path: str, seeds: range, sd_factor: float = 1.0) -> tuple[float, float]:
    """Return normalised innovation squared and its degrees of freedom, each summed over runs.

    The filter assumes `sd_factor` times the true standard deviation of every sensor.
    """
    true = load("pavement", [path])[1].sensors
    assumed = {key: sd_factor * getattr(true, key) for key in SDS}
    changes = (f"controller.noise.{key}={sd!r}" for key, sd in assumed.items())
    scenario = load("pavement", [path, *changes])[1]
    squares = freedom = 0.0
    for seed in seeds:
        assembly = assemble(scenario, seed)
        recorder = Recorder()
        drive(assembly.setup(recorder), assembly.ticks)
        table = recorder.record()[ESTIMATE]
        squares += np.nansum(table["nis"])
        freedom += np.nansum(table["nis_dof"])
    return float(squares), float(freedom)


def band(freedom: float) -> tuple[float, float]:
    """Return the 95 % band of the sum; sums of independent chi-squares are chi-square."""
    low, high = chi2.ppf([0.025, 0.975], freedom)
    return (1.0 - CAUTION) * low, high


@pytest.mark.parametrize(
    "path", [STRAIGHT, pytest.param("path.laps=1", marks=pytest.mark.slow)], ids=["short", "lap"]
)
def test_innovations_of_ten_runs_match_their_covariance(path):
    squares, freedom = innovations(path, range(1, 11))
    assert freedom > 30_000
    low, high = band(freedom)
    assert low < squares < high, f"normalised innovation squared {squares / freedom:.4f} a degree"


GOOD_VALVES = ProcessNoise(steering=0.00165, steering_i=0.0009, scale_sd=1e-6)
"""The likeliest noise of valves without wear, see `ProcessNoise`, which no factor changes."""


def test_the_filter_learns_how_far_worn_valves_can_be_trusted():
    """Steering angles are as far off as claimed; with the noise of good valves fixed, they are not.

    The filter of good valves takes the command for the angle: its NEES is in the hundreds.
    """
    _, scenario = load("old-valves", [STRAIGHT])
    _, record = simulate("old-valves", scenario, 1)
    learning, fixed = (
        consistency(replay(record, estimator), record)
        for estimator in (
            estimator_of(scenario),
            ExtendedKalmanFilter(Vehicle(), process_noise=GOOD_VALVES),
        )
    )
    steering = [State.DELTA_T, State.DELTA_I]
    assert all(0.3 < learning.states[i].nees < 3.0 for i in steering)
    assert all(fixed.states[i].nees > 50.0 for i in steering)
    assert learning.log_likelihood > fixed.log_likelihood + 100.0
