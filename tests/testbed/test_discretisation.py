"""Times as counts of physics steps, values as multiples of a resolution."""

import math

import pytest
from proving_ground.testbed.discretisation import whole_steps
from proving_ground.testbed.errors import InvalidPlant


def test_a_period_of_whole_steps_is_their_number():
    assert whole_steps(0.2, 0.002, "period") == 100
    assert whole_steps(0.0, 0.002, "delay", least=0) == 0


@pytest.mark.parametrize("period", [0.003, 0.001, math.inf, math.nan, 0.0])
def test_any_other_period_is_refused_by_its_name(period):
    with pytest.raises(InvalidPlant, match=r"^rate of sensor x: .* whole number of physics steps"):
        whole_steps(period, 0.002, "rate of sensor x")
