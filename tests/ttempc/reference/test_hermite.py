"""Cubic Hermite interpolation: exact for cubics, equal to scipy's, smooth at the knots."""

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from ttempc.reference.hermite import CubicHermite

KNOTS = np.array([-1.0, 0.0, 0.3, 2.0, 2.5])


def test_a_cubic_is_its_own_interpolant_also_beyond_the_knots():
    cubic = np.polynomial.Polynomial([0.3, -2.0, 0.5, 1.7])
    found = CubicHermite(KNOTS, cubic(KNOTS), cubic.deriv()(KNOTS))
    places = np.linspace(-1.5, 3.0, 91)
    value, slope = found.at(places)
    assert value == pytest.approx(cubic(places), abs=1e-11)
    assert slope == pytest.approx(cubic.deriv()(places), abs=1e-11)


def test_values_and_slopes_are_those_of_scipy_in_any_shape():
    draw = np.random.default_rng(1)
    values, slopes = draw.normal(size=(2, len(KNOTS)))
    places = draw.uniform(-1.0, 2.5, (7, 3))
    known = CubicHermiteSpline(KNOTS, values, slopes)
    value, slope = CubicHermite(KNOTS, values, slopes).at(places)
    assert value == pytest.approx(known(places), abs=1e-12)
    assert slope == pytest.approx(known(places, 1), abs=1e-12)
