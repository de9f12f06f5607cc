"""The law of wheels on soil against numbers computed by hand from the printed equations.

No number here is read from the code: a coefficient that changes by 10 % must fail a test.
"""

from dataclasses import asdict, replace

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.scenario.scenario import dump, load
from proving_ground.testbed.vehicle.servos import equilibrium_slip, tyres_of, wheel_loads
from proving_ground.testbed.vehicle.vehicle import read_vehicle
from proving_ground.testbed.wheels import tyre
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.tyre import Tyres

LAW, RADIAL = SoilLaw(), SoilLaw(tyre="radial")

# (law, Bn, slip, gross traction ratio), 0.88 (1 - e^(-Bn/10)) (1 - e^(-7.5 s)) + 0.04:
GROSS_TRACTION = (
    (LAW, 20.0, 0.10, 0.441479),  # 0.88 x (1 - e^-2 = 0.864665) x (1 - e^-0.75 = 0.527633)
    (LAW, 20.0, 0.15, 0.553875),  # 0.88 x 0.864665 x (1 - e^-1.125 = 0.675348)
    (LAW, 40.0, 0.12, 0.552654),  # 0.88 x (1 - e^-4 = 0.981684) x (1 - e^-0.9 = 0.593430)
    (LAW, 55.0, 0.09, 0.470177),  # 0.88 x (1 - e^-5.5 = 0.995913) x (1 - e^-0.675 = 0.490844)
    (LAW, 80.0, 0.50, 0.899016),  # 0.88 x (1 - e^-8 = 0.999665) x (1 - e^-3.75 = 0.976482)
    (RADIAL, 20.0, 0.10, 0.527136),  # 0.88 x 0.864665 x (1 - e^-1.05 = 0.650062) + 0.0325
)
# (law, Bn, slip, motion resistance ratio), 1/Bn + 0.04 + 0.5 s / sqrt(Bn):
MOTION_RESISTANCE = (
    (LAW, 20.0, 0.10, 0.101180),  # 0.05 + 0.04 + 0.05 / 4.472136
    (LAW, 40.0, 0.12, 0.074487),  # 0.025 + 0.04 + 0.06 / 6.324555
    (LAW, 55.0, 0.09, 0.064250),  # 0.018182 + 0.04 + 0.045 / 7.416198
    (LAW, 80.0, 0.00, 0.052500),  # 0.0125 + 0.04: a towed wheel on concrete
    (LAW, 80.0, 0.50, 0.080451),  # 0.0125 + 0.04 + 0.25 / 8.944272
    (RADIAL, 20.0, 0.10, 0.088680),  # 0.9 / 20 + 0.0325 + 0.05 / 4.472136
)
# (law, M, slip angle [rad], side force ratio): mu (1 - e^(-slope / mu alpha)) with
# mu = 0.61 + 0.69 / M and slope = 2.34 + 0.088 M; radial mu = 0.8, slope = 2.79 + 0.16 M
SIDE_FORCE = (
    (LAW, 5.0, 0.2, 0.392300),  # mu 0.748, slope 2.78: 0.748 (1 - e^-0.743316)
    (LAW, 30.0, 0.02, 0.092159),  # mu 0.633, slope 4.98: 0.633 (1 - e^-0.157346)
    (LAW, 30.0, 0.1, 0.344775),  # 0.633 (1 - e^-0.786730)
    (LAW, 5.0, 3.0, 0.747989),  # 0.748 (1 - e^-11.149733)
    (RADIAL, 10.0, 0.1, 0.337863),  # 0.8 (1 - e^-0.548750)
)


def at(*values):
    return tuple(np.array([value]) for value in values)


def side_ratio(law, m, angle, bn=1e3):
    """Side force over load of a wheel without slip, by default on soil that bears any of it."""
    return law.combined_ratios(*at(bn, m, 0.0, angle))[1][0]


@pytest.mark.parametrize(("law", "bn", "slip", "expected"), GROSS_TRACTION)
def test_gross_traction_ratio_is_the_printed_equation(law, bn, slip, expected):
    assert law.gross_traction_ratio(*at(bn, slip))[0] == pytest.approx(expected, abs=1e-6)
    # what the soil carries is odd in the slip
    forward, backward = law.traction_ratio(*at(bn, slip)), law.traction_ratio(*at(bn, -slip))
    assert backward[0] == -forward[0]


@pytest.mark.parametrize(("law", "bn", "slip", "expected"), MOTION_RESISTANCE)
def test_motion_resistance_ratio_is_the_printed_equation(law, bn, slip, expected):
    assert law.motion_resistance_ratio(*at(bn, slip))[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(("law", "m", "angle", "expected"), SIDE_FORCE)
def test_side_force_ratio_is_the_printed_equation(law, m, angle, expected):
    assert side_ratio(law, m, angle) == pytest.approx(-expected, abs=2e-6)
    assert side_ratio(law, m, -angle) == pytest.approx(expected, abs=2e-6)


def test_net_traction_of_a_driven_wheel_is_that_of_brixius():
    """The 0.04 of gross traction cancels that of motion resistance.

    Bn = 20, s = 0.1: 0.401479 - 0.05 - 0.011180; Bn = 55, s = 0.09: 0.430177 - 0.018182 - 0.006068.
    """
    net = LAW.net_traction_ratio(np.array([20.0, 55.0]), np.array([0.1, 0.09]))
    np.testing.assert_allclose(net, [0.340299, 0.405927], atol=1e-6)


def test_side_force_is_limited_on_soft_soil_and_on_firm_ground():
    """Soil of Bn = 5 bears 0.88 (1 - e^-0.5) = 0.346253; the slope at M = 60 would be 7.62, is 6.

    The softer the soil, the less it bears sideways: mu of [G] alone grows.
    """
    assert side_ratio(LAW, 2.2, 9.0, bn=5.0) == pytest.approx(-0.346253, abs=1e-6)
    bn = np.linspace(0.5, 15.0, 30)
    assert (np.diff(LAW.largest_side_ratio(bn, 0.43 * bn)) > 0.0).all()
    assert LAW.side_stiffness(np.array([60.0]))[0] == pytest.approx(6.0)
    angle = 1e-5
    assert side_ratio(LAW, 60.0, angle) == pytest.approx(-6.0 * angle, rel=1e-4)


def test_mobility_numbers_are_the_printed_equations():
    """A tyre of b = 0.3 m, d = 1.2 m, h = 0.25 m, delta/h = 0.2 under 6 kN on 600 kPa.

    Cn = 600 x 0.3 x 1.2 / 6 = 36;  Bn = 36 (1 + 5 x 0.2) / (1 + 3 x 0.3 / 1.2) = 72 / 1.75;
    M = 36 sqrt(0.2) / (1 + 0.3 / 2.4) = 36 x 0.447214 / 1.125.
    """
    tyres = Tyres(
        radius=np.array([0.6]),
        width=np.array([0.3]),
        section_height=np.array([0.25]),
        relative_deflection=np.array([0.2]),
        rated_load=np.array([6000.0]),
        damping=np.array([0.0]),
        radial=np.array([False]),
    )
    bn, m = tyre.mobility(LAW, tyres, *at(6000.0, 600.0))
    assert bn[0] == pytest.approx(41.142857, abs=1e-6)
    assert m[0] == pytest.approx(14.310835, abs=1e-6)


@pytest.mark.parametrize("slip", [-0.4, 0.0, 0.03, 0.2, 0.7])
def test_slip_at_traction_inverts_the_traction_equation(slip):
    bn, slips = at(40.0, slip)
    assert LAW.slip_at_traction(bn, LAW.traction_ratio(bn, slips))[0] == pytest.approx(slip)


def test_combined_slip_by_hand():
    """Bn = 20, M = 5, s = 0.1, alpha = 0.2: x = 0.75, y = 2.78 / 0.748 x 0.2 = 0.743316.

    Under the tyre rho = 1.055944, (1 - e^-rho) / rho = 0.617586; traction is 0.760905 x 0.617586 x
    0.75. The soil beside it bears 1 - e^-(15 / 20)^2 = 0.430217: 0.748 (0.569783 x 0.617586 x
    0.743316 + 0.430217 (1 - e^-0.743316 = 0.524465)).
    """
    traction, side = LAW.combined_ratios(*at(20.0, 5.0, 0.1, 0.2))
    assert traction[0] == pytest.approx(0.352443, abs=2e-6)
    assert side[0] == pytest.approx(-0.364426, abs=3e-6)
    _, side = SoilLaw(side_beside_bn=0.0).combined_ratios(*at(20.0, 5.0, 0.1, 0.2))
    assert side[0] == pytest.approx(-0.343378, abs=2e-6)  # the vector sum alone


@pytest.mark.parametrize(
    ("cone_index", "expected"), [(600.0, 0.0209), (160.0, 0.0884), (120.0, 0.178)]
)
def test_free_slip_of_the_vehicle_of_the_paper(cone_index, expected):
    """From an independent evaluation of Brixius' equations, at the loads of the drive."""
    vehicle = read_vehicle()
    slip = equilibrium_slip(LAW, tyres_of(vehicle), wheel_loads(vehicle), cone_index, 0.0)
    assert slip == pytest.approx(expected, rel=0.015)


def test_radial_sizes_have_radial_coefficients_where_none_is_given():
    """11.2R24 and 16.9R34 are radial, 400/60-15.5 is not; a value of one's own is for all."""
    radial = tyres_of(read_vehicle("farm4500")).radial
    np.testing.assert_array_equal(radial, [True] * 4 + [False] * 2)
    law = SoilLaw(side=0.7).of(radial)
    np.testing.assert_array_equal(law.traction_slip, [10.5] * 4 + [7.5] * 2)
    assert law.side == 0.7
    assert law.of(radial).table(6).tolist() == law.table(6).tolist()
    assert SoilLaw(tyre="bias").of(radial).traction_slip == 7.5
    assert not tyres_of(read_vehicle()).radial.any()


def best_slip(bn):
    """Return the slip [%] of the best tractive efficiency, net over gross traction by (1 - s)."""
    slips = np.linspace(0.01, 0.4, 3901)
    numbers = np.full_like(slips, bn)
    net, gross = (law(numbers, slips) for law in (LAW.net_traction_ratio, LAW.gross_traction_ratio))
    return 100.0 * slips[(net / gross * (1.0 - slips)).argmax()]


def test_the_best_slip_on_firm_soil_is_the_published_one_and_grows_as_soil_softens():
    """University of Arizona Cooperative Extension: 8 to 10 % on firm soil, more on softer soil.

    Firm soil has Bn = 55 for drive tyres, tilled soil 40, soft soil 20 (ASABE D497).
    """
    assert 8.0 <= best_slip(55.0) <= 10.0
    assert best_slip(80.0) < best_slip(55.0) < best_slip(40.0) < best_slip(20.0)


# --- the law as a table of a scenario ---------------------------------------------------------


def test_a_scenario_lists_all_coefficients_and_reads_them_back(tmp_path):
    _, scenario = load("grass", ["plant.wheel_law.relaxation_lat_m=0.45"])
    assert scenario.plant.wheel_law == replace(LAW, relaxation_lat_m=0.45)
    file = tmp_path / "mine.toml"
    file.write_text(dump(scenario))
    assert load(str(file))[1].plant.wheel_law == scenario.plant.wheel_law
    assert all(f"{key} = " in file.read_text() for key in asdict(LAW))
    # another kind of tyre replaces the coefficients of a resolved file
    changes = ["plant.wheel_law.tyre='radial'", "plant.wheel_law.side=0.7"]
    law = load(str(file), changes)[1].plant.wheel_law
    assert law == replace(RADIAL, side=0.7, relaxation_lat_m=0.45)


def test_an_impossible_law_is_refused_in_one_line():
    for line in (
        "plant.wheel_law.traction=0.0",
        "plant.wheel_law.traction=nan",
        "plant.wheel_law.relaxation_lat_m=0.0001",
        "plant.wheel_law.damping_roll_s=0.5",
        "plant.wheel_law.tyre='solid'",
        "plant.wheel_law.relaxation=0.3",
    ):
        with pytest.raises(InvalidScenario, match="plant") as refusal:
            load("grass", [line])
        assert "\n" not in str(refusal.value)
