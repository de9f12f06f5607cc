"""The law of wheels on soil against numbers computed by hand from the printed equations.

No number here is read from the code: a coefficient that changes must fail one of these tests.
"""

import numpy as np
import pytest

from proving_ground.testbed.wheels import tyre
from proving_ground.testbed.wheels.tyre import Tyres

# (Bn, slip, gross traction ratio), 0.88 (1 - e^(-Bn/10)) (1 - e^(-7.5 s)):
GROSS_TRACTION = (
    (20.0, 0.10, 0.401479),  # 0.88 x (1 - e^-2 = 0.864665) x (1 - e^-0.75 = 0.527633)
    (20.0, 0.15, 0.513875),  # 0.88 x 0.864665 x (1 - e^-1.125 = 0.675348)
    (40.0, 0.12, 0.512654),  # 0.88 x (1 - e^-4 = 0.981684) x (1 - e^-0.9 = 0.593430)
    (55.0, 0.09, 0.430177),  # 0.88 x (1 - e^-5.5 = 0.995913) x (1 - e^-0.675 = 0.490844)
    (80.0, 0.50, 0.859016),  # 0.88 x (1 - e^-8 = 0.999665) x (1 - e^-3.75 = 0.976482)
)
# (Bn, slip, motion resistance ratio), 1/Bn + 0.04 + 0.5 s / sqrt(Bn):
MOTION_RESISTANCE = (
    (20.0, 0.10, 0.101180),  # 0.05 + 0.04 + 0.05 / 4.472136
    (40.0, 0.12, 0.074487),  # 0.025 + 0.04 + 0.06 / 6.324555
    (55.0, 0.09, 0.064250),  # 0.018182 + 0.04 + 0.045 / 7.416198
    (80.0, 0.00, 0.052500),  # 0.0125 + 0.04: a towed wheel on concrete
    (80.0, 0.50, 0.080451),  # 0.0125 + 0.04 + 0.25 / 8.944272
)
# (Bn1, slip angle [rad], side force ratio): mu (1 - e^(-slope / mu alpha)) with
# mu = 0.61 + 0.69 / Bn1 and slope = 2.34 + 0.088 Bn1
SIDE_FORCE = (
    (5.0, 0.2, 0.392300),  # mu 0.748, slope 2.78: 0.748 (1 - e^-0.743316)
    (30.0, 0.02, 0.092159),  # mu 0.633, slope 4.98: 0.633 (1 - e^-0.157346)
    (30.0, 0.1, 0.344775),  # 0.633 (1 - e^-0.786730)
)


def at(*values):
    return tuple(np.array([value]) for value in values)


@pytest.mark.parametrize(("bn", "slip", "expected"), GROSS_TRACTION)
def test_gross_traction_ratio_is_the_printed_equation(bn, slip, expected):
    assert tyre.gross_traction_ratio(*at(bn, slip))[0] == pytest.approx(expected, abs=1e-6)
    assert tyre.gross_traction_ratio(*at(bn, -slip))[0] == pytest.approx(-expected, abs=1e-6)


@pytest.mark.parametrize(("bn", "slip", "expected"), MOTION_RESISTANCE)
def test_motion_resistance_ratio_is_the_printed_equation(bn, slip, expected):
    assert tyre.motion_resistance_ratio(*at(bn, slip))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("bn1", "angle", "expected"), SIDE_FORCE)
def test_side_force_ratio_is_the_printed_equation(bn1, angle, expected):
    assert tyre.lateral_ratio(*at(bn1, angle))[0] == pytest.approx(-expected, abs=1e-6)


def test_mobility_numbers_are_the_printed_equations():
    """A tyre of b = 0.3 m, d = 1.2 m, h = 0.25 m, delta/h = 0.2 under 6 kN on 600 kPa.

    Cn = 600 x 0.3 x 1.2 / 6 = 36;  Bn = 36 (1 + 5 x 0.2) / (1 + 3 x 0.3 / 1.2) = 72 / 1.75;
    Bn1 = 36 sqrt(1.2 / 0.25) / (1 + 0.5 x 0.3 x 1.2) = 36 x 2.190890 / 1.18.
    """
    tyres = Tyres(
        radius=np.array([0.6]),
        width=np.array([0.3]),
        section_height=np.array([0.25]),
        relative_deflection=np.array([0.2]),
        rated_load=np.array([6000.0]),
        damping=np.array([0.0]),
    )
    bn, bn1 = tyre.mobility(tyres, *at(6000.0, 600.0))
    assert bn[0] == pytest.approx(41.142857, abs=1e-6)
    assert bn1[0] == pytest.approx(66.840716, abs=1e-5)


@pytest.mark.parametrize(("bn", "most"), [(5.0, 0.346253), (20.0, 0.760905), (80.0, 0.879705)])
def test_largest_traction_is_the_limit_of_full_slip(bn, most):
    """0.88 (1 - e^(-Bn/10)): 0.88 x 0.393469, 0.88 x 0.864665, 0.88 x 0.999665."""
    assert tyre.largest_traction(np.array([bn]))[0] == pytest.approx(most, abs=1e-6)
    assert tyre.largest_traction(*at(bn, 2000.0))[0] == pytest.approx(2000.0 * most, rel=1e-5)
    assert tyre.gross_traction_ratio(*at(bn, 10.0))[0] == pytest.approx(most, abs=1e-6)


@pytest.mark.parametrize("slip", [0.0, 0.03, 0.2, 0.7])
def test_slip_at_traction_inverts_the_traction_equation(slip):
    share = tyre.gross_traction_ratio(*at(40.0, slip)) / tyre.largest_traction(np.array([40.0]))
    assert tyre.slip_at_traction(share)[0] == pytest.approx(slip, abs=1e-12)


def best_slip(bn):
    """Return the slip [%] of the best tractive efficiency, (1 - MRR / GTR) (1 - s)."""
    slips = np.linspace(0.01, 0.4, 3901)
    numbers = np.full_like(slips, bn)
    gross = tyre.gross_traction_ratio(numbers, slips)
    efficiency = (1.0 - tyre.motion_resistance_ratio(numbers, slips) / gross) * (1.0 - slips)
    return 100.0 * slips[efficiency.argmax()]


def test_the_best_slip_on_firm_soil_is_the_published_one_and_grows_as_soil_softens():
    """University of Arizona Cooperative Extension: 8 to 10 % on firm soil, more on softer soil.

    Firm soil has Bn = 55 for drive tyres, tilled soil 40, soft soil 20 (ASABE D497).
    """
    assert 8.0 <= best_slip(55.0) <= 10.0
    assert best_slip(80.0) < best_slip(55.0) < best_slip(40.0) < best_slip(20.0)
