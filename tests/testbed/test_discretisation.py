"""Times as counts of physics steps, values as multiples of a resolution."""

import math

import pytest
from proving_ground.testbed.discretisation import quantised, whole_steps
from proving_ground.testbed.errors import InvalidPlant


def test_a_period_of_whole_steps_is_their_number():
    assert whole_steps(0.2, 0.002, "period") == 100
    assert whole_steps(0.0, 0.002, "delay", least=0) == 0


@pytest.mark.parametrize("period", [0.003, 0.001, math.inf, math.nan, 0.0])
def test_any_other_period_is_refused_by_its_name(period):
    with pytest.raises(InvalidPlant, match=r"^rate of sensor x: .* whole number of physics steps"):
        whole_steps(period, 0.002, "rate of sensor x")


@pytest.mark.parametrize("value", [-0.31, -0.05, 0.0, 0.149, 7.77])
def test_a_quantised_value_is_the_nearest_multiple(value):
    step = 0.1
    result = quantised(value, step)
    assert abs(result - value) <= 0.5 * step + 1e-12
    assert result / step == pytest.approx(round(result / step), abs=1e-9)
    assert quantised(value, 0.0) == value
