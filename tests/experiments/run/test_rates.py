"""Control rates from 5 to 100 Hz: a rate changes the commands, not what is driven."""

import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.errors import InvalidPlant

STRAIGHT = "path={kind='straight', length_m=14.0}"


@pytest.mark.parametrize(
    ("controller", "rate_hz"),
    [("pid", 50.0), ("pid", 100.0), ("lqr", 100.0), ("ttempc", 50.0), ("ttempc", 100.0)],
)
def test_fast_control_drives_as_well_as_slow_one(controller, rate_hz):
    errors = {}
    for rate in (5.0, rate_hz):
        overrides = [STRAIGHT, f"controller.name={controller}", f"control.rate_hz={rate}"]
        summary, record = simulate(*load("grass", overrides), 5101)
        assert summary.status == "completed"
        assert len(record["/control"]) == pytest.approx(14.0 * rate, abs=2)
        errors[rate] = summary.tracking.all.trailer.cross_p95_m
    assert errors[rate_hz] < errors[5.0] + 0.015


@pytest.mark.parametrize("rate_hz", [4.0, 101.0, 30.0])
def test_rates_out_of_range_or_between_physics_steps_are_refused(rate_hz):
    """The physics step is 2 ms: 30 Hz is no whole number of them."""
    with pytest.raises((InvalidScenario, InvalidPlant), match=r"rate_hz|control period"):
        simulate(*load("grass", [STRAIGHT, f"control.rate_hz={rate_hz}"]), 1)
