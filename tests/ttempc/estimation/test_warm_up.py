"""Compilation ahead of the first tick: complete, and without effect on estimates."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.ttempc.sensed_drive import GNSS, PERIOD_S, VEHICLE, SensedDrive
from ttempc.baselines.nmhe import MovingHorizonEstimator
from ttempc.estimation import filter as filter_kernels
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.models import augmented_state
from ttempc.types import Command

ESTIMATORS = [ExtendedKalmanFilter, MovingHorizonEstimator]


@pytest.fixture(scope="module")
def received():
    return SensedDrive(31).run(30).received


@pytest.mark.parametrize("estimator", ESTIMATORS)
def test_warm_up_changes_no_later_estimate(received, estimator):
    cold, warm = estimator(VEHICLE), estimator(VEHICLE)
    warm.warm_up()
    for k, (samples, command) in enumerate(received):
        if k == 20:
            warm.warm_up()
        one, other = (e.update(k * PERIOD_S, samples, command) for e in (cold, warm))
        for field in ("state", "covariance", "disturbance", "map_disturbance"):
            np.testing.assert_array_equal(getattr(other, field), getattr(one, field))
        assert other.innovations == one.innovations


def test_no_kernel_compiles_after_warm_up(tmp_path):
    """In a process of its own with an empty cache, see `check_no_compilation`."""
    subprocess.run(
        [sys.executable, "-c", f"from {__name__} import check_no_compilation as f; f()"],
        check=True,
        cwd=Path(__file__).parents[3],
        # Signatures are those of any level of optimisation; level 0 compiles faster.
        env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_OPT": "0"},
    )


def check_no_compilation():
    """Compare the compiled signatures after `warm_up` with those after 50 varied updates."""
    for estimator in (ExtendedKalmanFilter(VEHICLE), MovingHorizonEstimator(VEHICLE)):
        assert not any(signatures().values()) or isinstance(estimator, MovingHorizonEstimator)
        estimator.warm_up()
        compiled = signatures()
        assert all(compiled[name] for name in ("predict_until", "process"))
        SensedDrive(32, corrupt=varied, estimator=estimator).run(50)
        estimator.update(50 * PERIOD_S, [], None)
        estimator.update(11, [], Command(0, 0, 1))  # integers
        assert signatures() == compiled


def varied(measurements):
    """Return a tick's samples with gaps, outliers and values of other numeric types."""
    time_s = measurements[-1].time_s
    if 2.0 < time_s < 3.0:
        return []
    if 4.0 < time_s < 6.0:  # longer than the patience of the gate
        return [
            replace(m, value=(m.value[0] + 3.0, m.value[1])) if m.sensor in GNSS else m
            for m in measurements
        ]
    if time_s > 7.0:
        measurements = [replace(m, value=tuple(np.array(m.value))) for m in measurements]
    if time_s > 8.0:
        measurements = [replace(m, value=tuple(map(round, m.value))) for m in measurements]
    return measurements


def signatures():
    """Return the compiled signatures of every kernel by its name."""
    modules = augmented_state, filter_kernels
    members = {name: item for module in modules for name, item in vars(module).items()}
    return {n: tuple(v.signatures) for n, v in members.items() if hasattr(v, "signatures")}
