"""Replay of a log through an estimator, and its figures."""

import math
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidReplay
from proving_ground.experiments.logs.replay import (
    estimator_of,
    read_run,
    replay,
    same_as_recorded,
)
from proving_ground.experiments.results.consistency import consistency
from proving_ground.testbed.recording.channels import (
    ESTIMATE,
    MEASUREMENT,
    MEASUREMENT_COLUMNS,
    STATE,
)
from proving_ground.testbed.recording.record import Record, Table

from ttempc.types import Estimate, Innovation, Sensor


@pytest.fixture(scope="module")
def log(short_runs):
    return short_runs / "nominal" / "log.mcap"


@pytest.fixture(scope="module")
def run(log):
    return read_run(log)


def test_a_replay_returns_the_estimates_of_the_run_bit_for_bit(run):
    record, scenario = run
    estimates = replay(record, estimator_of(scenario))
    assert len(estimates) == len(record[ESTIMATE]) > 50
    assert same_as_recorded(estimates, record)


def test_a_status_that_is_no_number_is_refused(run):
    record, scenario = run
    samples = record[MEASUREMENT]
    values = samples.values.copy()
    values[:, MEASUREMENT_COLUMNS[Sensor.GNSS_TRACTOR].stop - 2] = math.nan
    wrong = {**record.tables, MEASUREMENT.topic: replace(samples, values=values)}
    with pytest.raises(InvalidReplay, match="status of gnss_tractor"):
        replay(replace(record, tables=wrong), estimator_of(scenario))


def test_figures_of_estimates_with_known_errors():
    """Errors of two claimed standard deviations: NEES 4; alternating innovations: -1."""
    time_s = np.linspace(0.0, 19.8, 100)
    names = STATE.fields
    values = np.zeros((100, len(names)))
    values[:, names.index("v_mps")] = 1.0
    record = Record({STATE.topic: Table(STATE, time_s, values)})
    sd = np.array([0.01, 0.02, 0.003, 0.004, 0.005, 0.006, 0.07])
    estimates = [
        Estimate(
            time_s=t,
            state=np.array([0, 0, 2 * math.pi, 0, 0, 0, 1.0]) + 2.0 * sd,  # a whole turn counts not
            covariance=np.diag(sd**2),
            trailer_xy=np.array([0.3, 0.4]),
            hitch_angle=0.0,
            innovations=(
                Innovation(Sensor.HITCH, 4.0, 1, k % 2 == 0, (2.0 * (-1) ** k,), math.log(0.25)),
            ),
        )
        for k, t in enumerate(time_s)
    ]
    figures = consistency(estimates, record)
    for item, claimed in zip(figures.states, sd, strict=True):
        assert item.nees == pytest.approx(4.0)
        assert item.claimed == pytest.approx(claimed)
        assert [item.rms, item.bias] == pytest.approx([2.0 * claimed] * 2)
    assert figures.trailer_m == pytest.approx(0.5)
    assert figures.tractor_m == pytest.approx(2.0 * math.hypot(0.01, 0.02))
    (hitch,) = figures.sensors
    assert (hitch.samples, hitch.rejected) == (60, 30)  # from 8 s on
    assert hitch.nis == pytest.approx(4.0)
    assert hitch.autocorrelation == pytest.approx(-59 / 60)
    normal = -0.5 * (4.0 + math.log(0.25) + math.log(2.0 * math.pi))
    assert figures.log_likelihood == pytest.approx(60 * normal)


def test_the_command_prints_states_and_sensors_and_refuses_what_cannot_be_replayed(log, capsys):
    assert main(["log", "replay", str(log)]) == 0
    printed = capsys.readouterr().out
    for word in ("the estimates of the run", "delta_i", "NEES", "gnss_trailer", "log-likelihood"):
        assert word in printed
    for arguments, reason in (
        (["--estimator", "truth"], "truth"),
        (["--estimator", "kf"], "controller.estimator"),
        (["--set", "sensors.gnss_sd=1"], "gnss_sd"),
    ):
        assert main(["log", "replay", str(log), *arguments]) == 2
        error = capsys.readouterr().err
        assert reason in error
        assert len(error.splitlines()) == 1
