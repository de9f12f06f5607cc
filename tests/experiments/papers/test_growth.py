"""Growth: exponents, and every measure at its smallest size."""

import math

import numpy as np
import pytest
from proving_ground.experiments.papers import growth


@pytest.mark.parametrize("power", [-1.0, 0.0, 0.5, 2.0])
def test_the_exponent_is_that_of_a_power_law(power):
    sizes = np.array([3.0, 10.0, 400.0])
    assert growth.exponent(sizes, 7.0 * sizes**power) == pytest.approx(power, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", growth.GROWTHS)
def test_every_figure_is_measured(name, monkeypatch):
    monkeypatch.setattr(growth, "REPEATS", 1)
    one = growth.GROWTHS[name]
    figures = one.measure(one.sizes[0])
    assert figures
    assert all(math.isfinite(value) and value > 0.0 for value in figures.values()), figures
