"""Tube of the true deviation: laws of the exact step beside the linear one."""

import numpy as np
import pytest
from proving_ground.experiments.scenario.tube_file import read_tube
from proving_ground.experiments.studies.ablations.true_deviation import exact_step

from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import tracking_system

PERIOD_S = 0.2
TICK = 120


@pytest.fixture(scope="module")
def reference():
    return Reference(figure_eight(laps=1), read_tube("grass").design().vehicle, ConstantSpeed(1.0))


def test_without_deviation_there_is_no_error_after_the_step(reference):
    after = exact_step(reference, PERIOD_S, TICK, np.zeros(7), np.zeros(3))
    assert after == pytest.approx(np.zeros(7), abs=1e-12)


def test_the_remainder_is_quadratic_in_the_deviation(reference):
    matrices = error_dynamics(reference, PERIOD_S, TICK + 1)
    system = tracking_system(*matrices, read_tube("grass").design().weights)
    direction = np.array([0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.05])

    def remainder(size):
        error = size * direction
        u_e = system.gains[TICK] @ error
        linear = system.a[TICK] @ error + system.b[TICK] @ u_e
        return exact_step(reference, PERIOD_S, TICK, error, u_e) - linear

    # The linear model takes the Jacobian in the middle of the step, so that a small linear part
    # remains: the ratio is 4 up to that.
    large, small = remainder(1.0)[:4], remainder(0.5)[:4]
    assert np.linalg.norm(large) / np.linalg.norm(small) == pytest.approx(4.0, rel=0.15)
