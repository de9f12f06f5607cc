"""The law of a wheel on soil: contact, traction, side force, and its compiled version."""

import itertools
import math
from dataclasses import fields

import numpy as np
import pytest

from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.truth import Wheels
from proving_ground.testbed.vehicle.servos import tyres_of
from proving_ground.testbed.vehicle.vehicle_file import read_vehicle
from proving_ground.testbed.wheels import tyre
from proving_ground.testbed.wheels.tyre import Tyres, WheelMotion
from proving_ground.testbed.wheels.tyre_kernel import Output, wheel_step

DT = 0.002
FLAT = terrain.flat((20.0, 20.0))


@pytest.fixture(scope="module")
def tyres():
    return tyres_of(read_vehicle())


def motion(centre, axle, velocity, rotation):
    return WheelMotion(
        *(np.atleast_2d(np.asarray(a, float)) for a in (centre, axle, velocity, rotation))
    )


def one(tyres, index=2) -> Tyres:
    """The rear left tyre alone."""
    return Tyres(
        **{name: getattr(tyres, name)[index : index + 1] for name in Tyres.__dataclass_fields__}
    )


def height_at(tyres, load):
    """Height of the axle at which one standing wheel carries `load` on level ground."""
    low, high = 0.5 * tyres.radius[0], tyres.radius[0]
    for _ in range(60):
        z = 0.5 * (low + high)
        stand = motion([0, 0, z], [0, 1, 0], [0, 0, 0], [0, 0, 0])
        if tyre.contact(tyres, FLAT, stand).load[0] > load:
            low = z
        else:
            high = z
    return z


def steady(tyres, cone_index, velocity, spin, axle=(0.0, 1.0, 0.0), load=2500.0):
    """Forces of one wheel on level ground after its tread has come to rest."""
    wheel = motion([0, 0, height_at(tyres, load)], axle, velocity, np.asarray(axle) * spin)
    state = np.zeros((1, 3))
    for _ in range(400):
        state, forces = tyre.step(tyres, FLAT, np.array([cone_index]), wheel, state, 0.02)
    return forces


def random_case(rng, tyres):
    """Six wheels in any motion on any ground, also in the air, on their side, off the field."""
    n = 6
    ground = terrain.rough("F", rng, (12.0, 12.0)).tilted(rng.uniform(0.0, 0.4), rng.uniform(-3, 3))
    xy = rng.uniform(-7.0, 7.0, (n, 2))
    lift = rng.uniform(-0.06, 0.03, n)
    centre = np.column_stack([xy, ground.height(*xy.T) + tyres.radius + lift])
    axle = rng.normal(size=(n, 3)) * np.array([1.0, 1.0, rng.choice([0.1, 1.0])])
    axle /= np.linalg.norm(axle, axis=1)[:, None]
    velocity = rng.normal(size=(n, 3)) * rng.choice([0.0, 1e-3, 1.5], (n, 1))
    rotation = axle * rng.normal(size=(n, 1)) * rng.choice([0.0, 4.0], (n, 1))
    rotation += rng.normal(size=(n, 3)) * 0.3
    deflection = rng.uniform(-1.0, 1.0, (n, 3)) * np.array([0.15, 0.3, 0.05])
    soil = SoilMap(float(rng.choice([60.0, 300.0, 2000.0])))
    return ground, soil, WheelMotion(centre, axle, velocity, rotation), deflection


def run_kernel(tyres, ground, soil, wheels, deflection):
    """Hand the same wheels to the compiled law, as six bodies of a MuJoCo-like state."""
    n = 6
    xpos = np.vstack([np.zeros((2, 3)), wheels.centre])
    xmat = np.zeros((n + 2, 9))
    xmat[2:, [1, 4, 7]] = wheels.axle
    com = np.tile([0.3, -0.2, 0.5], (n + 2, 1))
    cvel = np.zeros((n + 2, 6))
    cvel[2:, :3] = wheels.rotation
    cvel[2:, 3:] = wheels.velocity - np.cross(wheels.rotation, wheels.centre - com[2:])
    state, output, xfrc = deflection.copy(), np.zeros((n, len(Output))), np.zeros((n + 2, 6))
    wheel_step(
        tyre.LAW.table(),
        tyres.table(),
        ground.heights,
        soil.rasterised(ground),
        np.array([*ground.origin, ground.spacing_m, DT]),
        np.arange(2, n + 2),
        xpos,
        xmat,
        cvel,
        com,
        state,
        output,
        xfrc,
    )
    return state, output, xfrc[2:]


def test_the_columns_of_the_report_are_the_fields_of_wheels():
    assert [column.name.lower() for column in Output] == [item.name for item in fields(Wheels)]


def test_compiled_law_is_the_reference_law(tyres):
    rng = np.random.default_rng(20161)
    full_scale = 2e4  # [N], [N m]: the largest forces of these cases
    touching = 0
    for _ in range(300):
        ground, soil, wheels, deflection = random_case(rng, tyres)
        cone_index = np.full(6, soil.background)
        state, forces = tyre.step(tyres, ground, cone_index, wheels, deflection, DT)
        state_c, output, xfrc = run_kernel(tyres, ground, soil, wheels, deflection)
        touching += np.count_nonzero(forces.load)
        np.testing.assert_allclose(state_c, state, atol=1e-9 * 0.3, rtol=0)
        np.testing.assert_allclose(xfrc[:, :3], forces.force, atol=1e-9 * full_scale, rtol=0)
        np.testing.assert_allclose(xfrc[:, 3:], forces.moment, atol=1e-9 * full_scale, rtol=0)
        for column in Output:
            expected = getattr(forces, column.name.lower())
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(output[:, column], expected, atol=1e-9 * scale, rtol=0)
    assert touching > 500


def test_compiled_law_reads_the_soil_below_each_wheel(tyres):
    cone = np.arange(201 * 201, dtype=float).reshape(201, 201) + 100.0
    state, output, xfrc = np.zeros((6, 3)), np.zeros((6, len(Output))), np.zeros((8, 6))
    xpos = np.zeros((8, 3))
    xpos[2:, 0] = np.linspace(-8.0, 8.0, 6)
    xpos[2:, 1] = np.linspace(5.0, -6.0, 6)
    xmat = np.tile(np.eye(3).ravel(), (8, 1))
    grid = np.array([*FLAT.origin, FLAT.spacing_m, DT])
    arguments = (
        tyre.LAW.table(),
        tyres.table(),
        FLAT.heights,
        cone,
        grid,
        np.arange(2, 8),
        xpos,
        xmat,
    )
    wheel_step(*arguments, np.zeros((8, 6)), np.zeros((8, 3)), state, output, xfrc)
    column = np.rint((xpos[2:, 0] + 10.0) / 0.1).astype(int)
    row = np.rint((xpos[2:, 1] + 10.0) / 0.1).astype(int)
    np.testing.assert_array_equal(output[:, Output.CONE_INDEX], cone[row, column])


def test_rated_load_gives_rated_deflection(tyres):
    for index in range(6):
        single = one(tyres, index)
        deflection = single.radius[0] - height_at(single, single.rated_load[0])
        rated = single.relative_deflection[0] * single.section_height[0]
        assert deflection == pytest.approx(rated, abs=1e-6)


def test_rolling_on_level_ground_has_no_load_ripple(tyres):
    single = one(tyres)
    z = height_at(single, 2500.0)
    loads = [
        tyre.contact(single, FLAT, motion([x, 0.3 * x, z], [0, 1, 0], [1, 0, 0], [0, 2.5, 0])).load[
            0
        ]
        for x in np.linspace(0.0, 1.0, 200)
    ]
    assert np.ptp(loads) < 1e-9 * 2500.0


@pytest.mark.parametrize("slope", [0.1, 0.3])
@pytest.mark.parametrize("heading", [0.0, 1.0, 2.5])
def test_normal_stands_on_a_plane(tyres, slope, heading):
    ground = FLAT.tilted(slope, 0.4)
    normal = np.array([-math.tan(slope) * math.cos(0.4), -math.tan(slope) * math.sin(0.4), 1.0])
    normal /= np.linalg.norm(normal)
    axle = np.array([-math.sin(heading), math.cos(heading), 0.0])
    axle -= (axle @ normal) * normal
    single = one(tyres)
    wheel = motion(
        normal * (single.radius[0] - 0.03), axle / np.linalg.norm(axle), [0, 0, 0], [0, 0, 0]
    )
    touch = tyre.contact(single, ground, wheel)
    np.testing.assert_allclose(touch.normal[0], normal, atol=1e-9)


def test_elastic_contact_makes_no_energy(tyres):
    """The undamped force is a gradient: no work over any closed path, turned and lifted as well."""
    single = one(tyres)
    single = Tyres(
        **{**{n: getattr(single, n) for n in Tyres.__dataclass_fields__}, "damping": np.zeros(1)}
    )
    ground = Terrain(FLAT.heights + 0.02 * np.sin(np.arange(201) * 0.3), 0.1, FLAT.origin)
    angles = np.linspace(0.0, 2.0 * math.pi, 5001)
    path = np.stack(
        [0.4 * np.cos(angles), 0.3 * np.sin(angles), 0.38 + 0.01 * np.sin(2 * angles)], axis=1
    )
    work, gross = 0.0, 0.0
    for start, end in itertools.pairwise(path):
        middle = motion(0.5 * (start + end), [0, 1, 0], [0, 0, 0], [0, 0, 0])
        touch = tyre.contact(single, ground, middle)
        power = touch.load[0] * touch.normal[0] @ (end - start)
        work, gross = work + power, gross + abs(power)
    assert abs(work) < 1e-4 * gross


@pytest.mark.parametrize("cone_index", [150.0, 600.0, 2000.0])
@pytest.mark.parametrize("slip", [-0.3, -0.05, 0.02, 0.1, 0.5])
@pytest.mark.parametrize("direction", [1.0, -1.0])
def test_steady_pull_is_the_traction_equation_forwards_and_backwards(
    tyres, cone_index, slip, direction
):
    single = one(tyres)
    v = direction * 1.0
    spin = v / single.radius[0] * (1.0 / (1.0 - slip) if slip > 0 else 1.0 + slip)
    forces = steady(single, cone_index, [v, 0, 0], spin)
    bn, _ = tyre.mobility(single, forces.load, np.array([cone_index]))
    # in travel direction, slip positive when driving
    expected = tyre.gross_traction_ratio(bn, np.array([slip])) - tyre.motion_resistance_ratio(
        bn, np.array([slip])
    )
    assert direction * forces.force_long[0] / forces.load[0] == pytest.approx(expected[0], abs=1e-6)
    assert direction * forces.slip[0] == pytest.approx(slip, abs=1e-9)


@pytest.mark.parametrize("angle_deg", [-20.0, -2.0, 0.5, 5.0])
def test_steady_side_force_is_the_lateral_equation_and_opposes_the_drift(tyres, angle_deg):
    single, angle = one(tyres), math.radians(angle_deg)
    v = np.array([math.cos(angle), math.sin(angle), 0.0])
    forces = steady(single, 600.0, v, v[0] / single.radius[0])
    _, bn1 = tyre.mobility(single, forces.load, np.array([600.0]))
    expected = tyre.lateral_ratio(bn1, np.array([angle]))[0]
    assert forces.force_lat[0] / forces.load[0] == pytest.approx(expected, rel=1e-3)
    assert forces.slip_angle[0] == pytest.approx(angle)
    assert forces.force_lat[0] * angle < 0.0


def test_lateral_stiffness_stays_finite_on_ground_that_does_not_yield(tyres):
    alpha = np.array([1e-4])
    slopes = [
        -tyre.lateral_ratio(tyre.mobility(one(tyres), np.array([2500.0]), np.array([ci]))[1], alpha)
        / alpha
        for ci in (100.0, 2000.0, 1e7)
    ]
    assert slopes[0] < 0.8 * tyre.LATERAL_STIFFNESS_LIMIT
    np.testing.assert_allclose(slopes[1:], tyre.LATERAL_STIFFNESS_LIMIT, rtol=1e-3)


def test_forces_stay_inside_the_friction_ellipse(tyres):
    rng = np.random.default_rng(5)
    single = one(tyres)
    for _ in range(15):
        angle, spin = rng.uniform(-1.0, 1.0), rng.uniform(0.0, 10.0)
        forces = steady(single, 300.0, [math.cos(angle), math.sin(angle), 0], spin)
        bn, bn1 = tyre.mobility(single, forces.load, np.array([300.0]))
        largest_long = tyre.largest_traction(bn, forces.load)
        largest_lat = forces.load * tyre.largest_side_ratio(bn1)
        # gross traction: the moment about the axle over the radius
        gross = -forces.moment[0, 1] / single.radius
        assert np.hypot(gross / largest_long, forces.force_lat / largest_lat) <= 1.0 + 1e-9


def test_spinning_wheel_loses_side_force(tyres):
    single = one(tyres)
    v = np.array([1.0, 0.05, 0.0])
    rolling = steady(single, 300.0, v, 1.0 / single.radius[0])
    spinning = steady(single, 300.0, v, 3.0 / single.radius[0])
    assert abs(spinning.force_lat[0]) < 0.6 * abs(rolling.force_lat[0])


def test_side_force_builds_up_over_the_relaxation_length(tyres):
    """After one relaxation length a small steady side force has reached 63 %.

    The tread's damping leads by its time over that of the relaxation, 0.02 s of 0.3 s.
    """
    single, v = one(tyres), np.array([1.0, 0.002, 0.0])
    wheel = motion([0, 0, height_at(single, 2500.0)], [0, 1, 0], v, [0, 1.0 / single.radius[0], 0])
    state, dt = np.zeros((1, 3)), 1e-3
    for _ in range(round(tyre.RELAXATION_LAT / dt)):
        state, forces = tyre.step(single, FLAT, np.array([600.0]), wheel, state, dt)
    final = steady(single, 600.0, v, 1.0 / single.radius[0])
    lead = tyre.TREAD_DAMPING_LAT / tyre.RELAXATION_LAT
    assert forces.force_lat[0] / final.force_lat[0] == pytest.approx(
        1.0 - (1.0 - lead) * math.exp(-1.0), abs=0.003
    )


def test_standing_wheel_holds_like_a_spring_in_every_direction(tyres):
    single = one(tyres)
    stand = motion([0, 0, height_at(single, 2500.0)], [0, 1, 0], [0, 0, 0], [0, 0, 0])
    state = np.array([[0.004, 0.004, 0.0]])
    first = tyre.step(single, FLAT, np.array([600.0]), stand, state, DT)
    later = first
    for _ in range(5000):
        later = tyre.step(single, FLAT, np.array([600.0]), stand, later[0], DT)
    np.testing.assert_array_equal(later[0], first[0])
    assert later[1].force_lat[0] < -50.0


def test_no_load_in_the_air_and_never_a_pull(tyres):
    single = one(tyres)
    z = height_at(single, 2500.0)
    leaving = motion([0, 0, z], [0, 1, 0], [0, 0, 50.0], [0, 0, 0])
    assert tyre.contact(single, FLAT, leaving).load[0] == 0.0
    air = motion([0, 0, 2.0], [0, 1, 0], [1, 0, 0], [0, 2.5, 0])
    state, forces = tyre.step(single, FLAT, np.array([600.0]), air, np.full((1, 3), 0.01), DT)
    assert not forces.force.any()
    assert not forces.moment.any()
    assert not state.any()


def test_motion_resistance_brakes_the_hub_but_not_the_axle(tyres):
    single = one(tyres)
    forces = steady(single, 600.0, [1.0, 0, 0], 1.0 / single.radius[0])
    bn, _ = tyre.mobility(single, forces.load, np.array([600.0]))
    resistance = tyre.motion_resistance_ratio(bn, np.zeros(1)) * forces.load
    assert forces.force_long[0] == pytest.approx(-resistance[0], rel=1e-6)
    assert forces.moment[0, 1] == pytest.approx(0.0, abs=1e-6)
