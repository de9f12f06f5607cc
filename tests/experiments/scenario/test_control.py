"""Control rate: refusals, records that fit it, a loop and a drive at another rate."""

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidFit, InvalidScenario
from proving_ground.experiments.run.assembly import check
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.plant import record_rate, record_steps
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.tubes.fit import fit_run
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.recording.channels import CONTROL, ESTIMATE, STATE

from ttempc.errors import InvalidTube

SHORT = 'path={kind="straight",length_m=12.0}'


@pytest.mark.parametrize("rate_hz", [4.0, 30.0, float("nan")])
def test_a_rate_outside_the_range_is_refused(rate_hz):
    with pytest.raises(InvalidScenario, match="rate_hz"):
        load("grass", (f"control.rate_hz={rate_hz}",))


def test_a_period_between_physics_steps_is_refused():
    with pytest.raises(InvalidPlant, match="control period"):
        check(load("grass", ("control.rate_hz=7.0",))[1])


@pytest.mark.parametrize("rate_hz", [5.0, 10.0, 12.5, 20.0, 25.0])
def test_rows_of_the_truth_fall_on_ticks_and_on_physics_steps(rate_hz):
    record_hz = record_rate(0.002, 1.0 / rate_hz)
    steps = record_steps(0.002, 1.0 / rate_hz, record_hz)
    assert record_hz >= 25.0
    assert (1.0 / rate_hz / 0.002) % steps == pytest.approx(0.0)


def test_a_tube_is_refused_at_another_rate_and_not_fitted_there():
    tube = ('controller.name="ttempc-tube"', "control.rate_hz=10.0", SHORT)
    with pytest.raises(InvalidTube, match="period_s"):
        check(load("grass", tube)[1])
    scenario = load("grass", ("control.rate_hz=10.0", SHORT))[1]
    _, record = simulate("grass", scenario, 1)
    with pytest.raises(InvalidFit, match="rate_hz = 10"):
        fit_run(record, scenario)


@pytest.mark.parametrize("rate_hz", [10.0, 25.0])
def test_a_faster_loop_has_a_command_a_period_and_stays_on_the_line(rate_hz):
    summary, record = simulate("grass", load("grass", (f"control.rate_hz={rate_hz}", SHORT))[1], 1)
    assert summary.status == "completed"
    np.testing.assert_allclose(np.diff(record[CONTROL].time_s), 1.0 / rate_hz, atol=1e-9)
    assert np.isin(record[ESTIMATE].time_s, record[STATE].time_s).all()
    error = summary.tracking.all.trailer.mean_euclidean_m
    assert error is not None
    assert error < 0.04
