"""The compiled law of a wheel on soil: contact, traction, side force, passivity."""

import itertools
import math
from types import SimpleNamespace

import numpy as np
import pytest
from proving_ground.testbed.bodies import Bodies
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.ground import Ground
from proving_ground.testbed.ground.surface import Surface
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.truth import Wheels
from proving_ground.testbed.wheels import tyre
from proving_ground.testbed.wheels.ruts import Ruts
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.tyre import Tyres, WheelMotion
from proving_ground.testbed.wheels.tyre_kernel import WheelSet, wheel_step

DT = 0.002
FLAT = terrain.flat((20.0, 20.0))
LAW = SoilLaw()


def still_bodies(n):
    """Return MuJoCo-like arrays of n wheels, bodies 2 to n + 1, at rest at the origin."""
    return Bodies(
        positions=np.zeros((n + 2, 3)),
        axes=np.zeros((n + 2, 9)),
        mass_centres=np.zeros((n + 2, 3)),
        velocities=np.zeros((n + 2, 6)),
        subtree_centres=np.tile([0.3, -0.2, 0.5], (n + 2, 1)),
        wrenches=np.zeros((n + 2, 6)),
    )


def motion(centre, axle, velocity, rotation):
    return WheelMotion(
        *(np.atleast_2d(np.asarray(a, float)) for a in (centre, axle, velocity, rotation))
    )


def step(tyres, ground, cone_index, wheels, deflection, dt, law=LAW):
    """Hand n wheels to the compiled law as bodies of a MuJoCo-like state.

    Returns:
        Tread deflections (n, 4) after `dt` [s], and the forces of the ground.
    """
    n = len(wheels.centre)
    bodies = still_bodies(n)
    bodies.positions[2:] = wheels.centre
    bodies.axes[2:, [1, 4, 7]] = wheels.axle
    bodies.velocities[2:, :3] = wheels.rotation
    arms = wheels.centre - bodies.subtree_centres[2:]
    bodies.velocities[2:, 3:] = wheels.velocity - np.cross(wheels.rotation, arms)
    kernel = WheelSet(
        law=law.table(n),
        tyres=tyres.table(LAW),
        surface=Surface.of(Ground(ground, np.full(ground.heights.shape, cone_index))),
        ruts=Ruts.none(),
        bodies=bodies,
        numbers=np.arange(2, n + 2),
        treads=np.array(deflection, dtype=float).reshape(n, 4),
        output=np.zeros((n, len(Wheels._fields))),
        timestep=dt,
    )
    wheel_step(kernel)
    report = Wheels(*kernel.output.T)
    wrenches = bodies.wrenches[2:]
    forces = SimpleNamespace(force=wrenches[:, :3], moment=wrenches[:, 3:], **report._asdict())
    return kernel.treads, forces


def one(tyres, index=2) -> Tyres:
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
    state = np.zeros((1, 4))
    for _ in range(400):
        state, forces = step(tyres, FLAT, cone_index, wheel, state, 0.02)
    return forces


def test_rated_load_gives_rated_deflection(tyres):
    for index in range(6):
        single = one(tyres, index)
        deflection = single.radius[0] - height_at(single, single.rated_load[0])
        rated = single.relative_deflection[0] * single.section_height[0]
        assert deflection == pytest.approx(rated, abs=1e-6)


def test_load_grows_with_deflection_as_of_a_winkler_bed_without_steps(tyres):
    """W ~ deflection^1.5 within 5 % from half to twice the rated load; no jump of the stiffness."""
    single = one(tyres)
    rated = single.relative_deflection[0] * single.section_height[0]
    deflections = np.linspace(0.25, 1.7, 400) * rated
    stands = [
        motion([0, 0, single.radius[0] - d], [0, 1, 0], [0, 0, 0], [0, 0, 0]) for d in deflections
    ]
    load = np.array([tyre.contact(single, FLAT, stand).load[0] for stand in stands])
    usual = load > 0.5 * single.rated_load[0]
    winkler = single.rated_load[0] * (deflections / rated) ** 1.5
    np.testing.assert_allclose(load[usual], winkler[usual], rtol=0.05)
    stiffness = np.diff(load)
    assert (stiffness[1:] / stiffness[:-1]).max() < 1.02


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
def test_steady_pull_and_torque_are_the_traction_equations_forwards_and_backwards(
    tyres, cone_index, slip, direction
):
    single = one(tyres)
    v = direction * 1.0
    spin = v / single.radius[0] * (1.0 / (1.0 - slip) if slip > 0 else 1.0 + slip)
    forces = steady(single, cone_index, [v, 0, 0], spin)
    bn, _ = tyre.mobility(LAW, single, forces.load, np.array([cone_index]))
    # in travel direction, slip positive when driving
    slips = np.array([slip])
    net, gross = LAW.net_traction_ratio(bn, slips), LAW.gross_traction_ratio(bn, slips)
    net = np.maximum(net, -LAW.largest_traction_ratio(bn))  # the ellipse
    torque = -forces.moment[0, 1] / single.radius / forces.load
    assert direction * forces.force_long[0] / forces.load[0] == pytest.approx(net[0], abs=1e-6)
    assert direction * torque[0] == pytest.approx(gross[0], abs=1e-6)
    assert direction * forces.slip[0] == pytest.approx(slip, abs=1e-9)


@pytest.mark.parametrize("cone_index", [120.0, 600.0, 2000.0])
def test_a_wheel_without_torque_has_the_whole_motion_resistance(tyres, cone_index):
    """1 / Bn + 0.04 at the hub, none of it from nothing: the torque about the axle is zero."""
    single = one(tyres)
    load = np.array([2500.0])
    bn, _ = tyre.mobility(LAW, single, load, np.array([cone_index]))
    skid = LAW.towed_slip(bn)[0]
    forces = steady(single, cone_index, [1.0, 0, 0], (1.0 + skid) / single.radius[0])
    assert forces.moment[0, 1] / single.radius[0] == pytest.approx(0.0, abs=1e-4 * load[0])
    assert -forces.force_long[0] / load[0] == pytest.approx(1.0 / bn[0] + 0.04, abs=1e-5)


@pytest.mark.parametrize("angle_deg", [-20.0, -2.0, 0.5, 5.0])
@pytest.mark.parametrize("cone_index", [600.0, 2000.0])  # below and at the largest stiffness
def test_steady_side_force_is_the_lateral_equation_and_opposes_the_drift(
    tyres, angle_deg, cone_index
):
    single, angle = one(tyres), math.radians(angle_deg)
    v = np.array([math.cos(angle), math.sin(angle), 0.0])
    forces = steady(single, cone_index, v, v[0] / single.radius[0])
    bn, m = tyre.mobility(LAW, single, forces.load, np.array([cone_index]))
    expected = LAW.combined_ratios(bn, m, 0.0, np.array([angle]))[1][0]
    assert forces.force_lat[0] / forces.load[0] == pytest.approx(expected, rel=1e-3)
    assert forces.slip_angle[0] == pytest.approx(angle)
    assert forces.force_lat[0] * angle < 0.0


def alike(tyres, n) -> Tyres:
    return Tyres(
        **{name: np.repeat(getattr(tyres, name)[2], n) for name in Tyres.__dataclass_fields__}
    )


def any_motions(rng, tyres, n):
    """Wheels on level ground that roll, slide, spin, turn, are locked, or are close to rest."""
    scale = rng.choice([1e-3, 0.05, 1.0], (n, 1))
    velocity = scale * rng.normal(size=(n, 3)) * [1.0, 1.0, 0.0]
    velocity[:, 1:2] *= rng.choice([0.0, 0.2, 1.0], (n, 1))
    spin = scale * rng.choice([0.0, 1.0, 2.5], (n, 1)) * rng.normal(size=(n, 1)) / 0.4
    velocity[0], spin[0] = (1.0, 0.0, 0.0), 0.0  # locked
    centre = np.tile([0.0, 0.0, height_at(one(tyres), 2500.0)], (n, 1))
    axle = np.tile([0.0, 1.0, 0.0], (n, 1))
    turn = rng.normal(size=(n, 1)) * rng.choice([0.0, 0.1, 2.0], (n, 1))
    turn[0] = 0.0
    return WheelMotion(centre, axle, velocity, axle * spin + [0.0, 0.0, 1.0] * turn)


def power(wheels, forces):
    """Power of the ground on each wheel, (n,)."""
    return (forces.force * wheels.velocity + forces.moment * wheels.rotation).sum(axis=1)


@pytest.mark.parametrize("bore", [0.0, 1.0])
@pytest.mark.parametrize("cone_index", [40.0, 120.0, 300.0, 600.0, 2000.0])
def test_forces_stay_inside_the_ellipse_and_only_take_energy(tyres, cone_index, bore):
    """Traction and side force; the hub of a locked wheel has the larger of grip and resistance."""
    many = alike(tyres, 200)
    wheels = any_motions(np.random.default_rng(5), tyres, 200)
    state = np.zeros((200, 4))
    for _ in range(400):
        state, forces = step(many, FLAT, cone_index, wheels, state, 0.02, SoilLaw(bore=bore))
    bn, m = tyre.mobility(LAW, many, forces.load, np.full(200, cone_index))
    grip_long = LAW.largest_traction_ratio(bn) * forces.load
    grip_lat = LAW.largest_side_ratio(bn, m) * forces.load
    resistance = (1.0 / bn + 0.04) * forces.load
    used = np.abs(forces.force_long) / np.maximum(grip_long, resistance)
    assert np.abs(forces.force_lat / grip_lat).max() <= 1.0 + 1e-9
    rolls = np.abs(wheels.velocity[:, 0]) > 0.01  # below, the tread is a spring
    braked = rolls & (forces.slip * wheels.velocity[:, 0] < 0.0)
    assert used[braked].max() <= 1.0 + 1e-9
    assert used[0] > 0.99
    assert power(wheels, forces).max() <= 1e-9 * forces.load[0]


@pytest.mark.parametrize(
    ("cone_index", "angle"), [(40.0, 0.0), (120.0, 0.0), (120.0, 0.1), (300.0, 0.0)]
)
def test_an_undriven_wheel_has_the_resistance_of_brixius_on_any_soil(tyres, cone_index, angle):
    """Its torque is that of nothing: traction is minus the tyre's resistance, 0.04.

    The farm trailer at 120 kPa has 1 / Bn = 0.49, more than its traction could ever carry.
    """
    single = one(tyres)
    bn, _ = tyre.mobility(LAW, single, np.array([2500.0]), np.array([cone_index]))
    slip = float(LAW.towed_slip(bn)[0])
    spin = (1.0 + slip) / single.radius[0]
    wheel = motion([0, 0, height_at(single, 2500.0)], [0, 1, 0], [1, -angle, 0], [0, spin, 0])
    state = np.zeros((1, 4))
    for _ in range(500):
        state, forces = step(single, FLAT, cone_index, wheel, state, 0.02)
    expected = 1.0 / bn + 0.04 * (angle == 0.0)
    assert -forces.force_long / forces.load == pytest.approx(
        expected, abs=0.04 * (angle > 0) + 1e-6
    )


def test_relaxation_length_of_each_tyre_is_cornering_over_lateral_stiffness(tyres):
    """8-16 at 2,500 N on 600 kPa, by hand from its file: C delta / 0.55, or half its contact.

    The share of a small steady side force after a distance x is 1 - (1 - tau v / sigma) e^(-x /
    sigma): two distances give sigma.
    """
    single = one(tyres)
    for cone_index in (150.0, 600.0, 2000.0):
        _, m = tyre.mobility(LAW, single, np.array([2500.0]), np.array([cone_index]))
        give = 0.2 * single.section_height[0] * 2500.0 / single.rated_load[0]
        contact = math.sqrt(give * (2.0 * single.radius[0] - give))
        length = max(contact, min(2.34 + 0.088 * m[0], 6.0) * give / 0.55)
        spin = 1.0 / single.radius[0]
        wheel = motion([0, 0, height_at(single, 2500.0)], [0, 1, 0], [1, 1e-4, 0], [0, spin, 0])
        state, side = np.zeros((1, 4)), []
        for _ in range(4000):
            state, forces = step(single, FLAT, cone_index, wheel, state, 0.001)
            side.append(forces.force_lat[0])
        lacking = 1.0 - np.array(side) / side[-1]
        found = 0.2 / math.log(lacking[99] / lacking[299])
        assert found == pytest.approx(length, rel=0.01)


def test_side_force_falls_with_slip_as_of_a_wheel_on_sand():
    """3D-RFT-wheel data, side force lost by slip [%], 95 % intervals; those at 15 deg are fitted.

    The wheel is small and rigid: Bn = 20 is assumed, on which the law is that of a radial tyre.
    """
    law = SoilLaw(tyre="radial")
    bn, m = np.full(4, 20.0), np.full(4, 7.0)
    slip, angle = np.array([0.23, 0.5, 0.23, 0.5]), np.radians([15.0, 15.0, 30.0, 30.0])
    free = law.combined_ratios(bn, m, 0.0, angle)[1]
    lost = 100.0 * (1.0 - law.combined_ratios(bn, m, slip, angle)[1] / free)
    assert (np.array([10.5, 34.7, -2.8, 24.8]) <= lost).all()
    assert (lost <= np.array([27.2, 49.0, 14.8, 42.7])).all()


def test_side_force_without_sinkage_stays_in_the_ellipse_with_traction():
    """On hard ground hardly any soil stands beside the tyre: the friction ellipse, within 3 %."""
    bn, m = np.full(200, 100.0), np.full(200, 40.0)
    slip, angle = np.random.default_rng(4).uniform([[0.0], [-0.5]], [[0.9], [0.5]], (2, 200))
    traction, side = LAW.combined_ratios(bn, m, slip, angle)
    ellipse = np.hypot(
        traction / LAW.largest_traction_ratio(bn), side / LAW.largest_side_ratio(bn, m)
    )
    assert ellipse.max() <= 1.03


@pytest.mark.parametrize(
    ("name", "length", "damping", "speed", "travel"),
    [
        ("long", 0.15, 0.01, 1.0, 0.15),
        ("lat", 0.30, 0.02, 1.0, 0.30),
        ("roll", 0.001, 0.06, 0.005, 0.0005),
    ],
)
def test_force_builds_up_over_its_relaxation_length(tyres, name, length, damping, speed, travel):
    """The share of a small steady force after a distance x at speed v.

    1 - (1 - damping v / length) e^(-x / length): the damping leads by its time over that of the
    relaxation.
    """
    single, dt, law = one(tyres), 1e-3 * travel / speed, SoilLaw(relaxation_lat_m=0.3)
    v = np.array([speed, 1e-4 * speed * (name == "lat"), 0.0])
    spin = speed * (1.0001 if name == "long" else 1.0) / single.radius[0]
    wheel = motion([0, 0, height_at(single, 2500.0)], [0, 1, 0], v, [0, spin, 0])

    def force(steps, dt):
        state = np.zeros((1, 4))
        for _ in range(steps):
            state, forces = step(single, FLAT, 600.0, wheel, state, dt, law=law)
        pull, side, moment = forces.force_long[0], forces.force_lat[0], forces.moment[0, 1]
        torque = -moment / single.radius[0] - 0.04 * forces.load[0]  # that of traction
        return {"long": torque, "lat": side, "roll": pull}[name]

    expected = 1.0 - (1.0 - damping * speed / length) * math.exp(-travel / length)
    assert force(1000, dt) / force(300, 100 * dt) == pytest.approx(expected, abs=0.001)


def standing_ring(single, load, cone_index):
    """By hand: radius of a disc in place of the contact times 2/3 [m]; C, mu, sigma of side slip.

    The disc has the mean of half length and half width of the contact for its radius (TMeasy).
    """
    bn, m = tyre.mobility(LAW, single, np.array([load]), np.array([cone_index]))
    give = 0.2 * single.section_height[0] * load / single.rated_load[0]
    half_length = math.sqrt(give * (2.0 * single.radius[0] - give))
    disc = 0.5 * (half_length + 0.5 * single.width[0])
    stiffness = min(2.34 + 0.088 * m[0], 6.0)
    limit = min(0.61 + 0.69 / m[0], 0.88, 0.88 * (1.0 - math.exp(-0.1 * bn[0])))
    return 2.0 / 3.0 * disc, stiffness, limit, max(half_length, stiffness * give / 0.55)


@pytest.mark.parametrize("direction", [1.0, -1.0])
@pytest.mark.parametrize("cone_index", [150.0, 600.0, 2000.0])
def test_a_wheel_that_turns_on_the_spot_bores_as_a_disc_of_even_pressure(
    tyres, cone_index, direction
):
    """A spring C W r^2 / sigma at first, 2/3 R mu W at last but for what a slip of 1 lacks."""
    single, load, rate = one(tyres), 2500.0, 0.2
    law = SoilLaw(bore=1.0, damping_lat_s=0.0)
    ring, stiffness, limit, length = standing_ring(single, load, cone_index)
    rotation = [0, 0, direction * rate]
    wheel = motion([0, 0, height_at(single, load)], [0, 1, 0], [0, 0, 0], rotation)
    state, moments, dt = np.zeros((1, 4)), [], 0.01
    angles = rate * dt * (1.0 + np.arange(1.2 * length / ring / (rate * dt)))
    for _ in angles:
        state, forces = step(single, FLAT, cone_index, wheel, state, dt, law=law)
        moments.append(-direction * forces.moment[0, 2])
    slip = np.minimum(1.0, ring * angles / length)
    expected = ring * limit * load * -np.expm1(-stiffness / limit * slip)
    np.testing.assert_allclose(moments, expected, rtol=1e-5)
    assert np.abs(forces.force[0, :2]).max() < 1e-9 * load


@pytest.mark.parametrize("bore_slip", [0.01, 0.2])
def test_boring_takes_side_force_away_and_fades_with_speed(tyres, bore_slip):
    """In steady rolling at 1 m/s: one vector of slip angle and bore slip, by hand."""
    single, law, load, angle = one(tyres), SoilLaw(bore=1.0, side_beside_bn=0.0), 2500.0, 0.1
    ring, stiffness, limit, _ = standing_ring(single, load, 600.0)
    spin = 1.0 / single.radius[0]
    rotation = [0, spin, bore_slip / ring]
    velocity = [1.0, math.tan(angle), 0.0]
    wheel = motion([0, 0, height_at(single, load)], [0, 1, 0], velocity, rotation)
    state = np.zeros((1, 4))
    for _ in range(400):
        state, forces = step(single, FLAT, 600.0, wheel, state, 0.02, law=law)
    size = math.hypot(angle, bore_slip)
    force = limit * load * (1.0 - math.exp(-stiffness / limit * size))
    assert -forces.force_lat[0] == pytest.approx(force * angle / size, rel=1e-5)
    assert -forces.moment[0, 2] == pytest.approx(ring * force * bore_slip / size, rel=1e-5)


def test_no_load_in_the_air_and_never_a_pull(tyres):
    single = one(tyres)
    z = height_at(single, 2500.0)
    leaving = motion([0, 0, z], [0, 1, 0], [0, 0, 50.0], [0, 0, 0])
    assert tyre.contact(single, FLAT, leaving).load[0] == 0.0
    air = motion([0, 0, 2.0], [0, 1, 0], [1, 0, 0], [0, 2.5, 0])
    state, forces = step(single, FLAT, 600.0, air, np.full((1, 4), 0.01), DT)
    assert not forces.force.any()
    assert not forces.moment.any()
    assert not state.any()


def test_forces_act_along_the_wheels_axes_at_the_centre_of_pressure(tyres):
    """Six wheels in any motion on any ground, also in the air, on their side, off the field."""
    rng, touching = np.random.default_rng(20161), 0
    for _ in range(100):
        ground = terrain.rough("F", rng, (12.0, 12.0))
        ground = ground.tilted(rng.uniform(0.0, 0.4), rng.uniform(-3, 3))
        xy = rng.uniform(-7.0, 7.0, (6, 2))
        above = ground.height(*xy.T) + tyres.radius + rng.uniform(-0.06, 0.03, 6)
        axle = rng.normal(size=(6, 3)) * np.array([1.0, 1.0, rng.choice([0.1, 1.0])])
        axle /= np.linalg.norm(axle, axis=1)[:, None]
        velocity = rng.normal(size=(6, 3)) * rng.choice([0.0, 1e-3, 1.5], (6, 1))
        rotation = 4.0 * axle * rng.normal(size=(6, 1)) + 0.3 * rng.normal(size=(6, 3))
        wheels = WheelMotion(np.column_stack([xy, above]), axle, velocity, rotation)
        _, forces = step(tyres, ground, 300.0, wheels, np.zeros((6, 4)), DT)
        touch = tyre.contact(tyres, ground, wheels)
        np.testing.assert_allclose(forces.load, touch.load, atol=1e-5)
        np.testing.assert_allclose(forces.ground, ground.height(*xy.T), atol=1e-12)
        ahead = np.cross(axle, touch.normal)
        ahead /= np.maximum(np.linalg.norm(ahead, axis=1), tyre.LEAST_UPRIGHT)[:, None]
        left = np.cross(touch.normal, ahead)
        sizes = (touch.load, forces.force_long, forces.force_lat)
        expected = sum(
            size[:, None] * way
            for size, way in zip(sizes, (touch.normal, ahead, left), strict=True)
        )
        np.testing.assert_allclose(forces.force, expected, atol=1e-5)
        # the moment about the axle is that of traction and tyre
        rest = forces.moment - np.cross(touch.point - wheels.centre, expected)
        np.testing.assert_allclose(np.cross(rest, axle), 0.0, atol=1e-5)
        rolling = np.einsum("nk,nk->n", velocity, ahead)
        rim = tyres.radius * np.einsum("nk,nk->n", rotation, axle)
        slip = (rim - rolling) / np.maximum(np.maximum(abs(rim), abs(rolling)), tyre.SMALL_SPEED)
        on = forces.load > 0.0
        np.testing.assert_allclose(forces.slip[on], slip[on], atol=1e-9)
        touching += np.count_nonzero(on)
    assert touching > 150


def test_compiled_law_reads_the_soil_below_each_wheel(tyres):
    cone = np.arange(201 * 201, dtype=float).reshape(201, 201) + 100.0
    bodies = still_bodies(6)
    bodies.positions[2:, 0] = np.linspace(-8.0, 8.0, 6)
    bodies.positions[2:, 1] = np.linspace(5.0, -6.0, 6)
    bodies.axes[:] = np.eye(3).ravel()
    kernel = WheelSet(
        law=LAW.table(6),
        tyres=tyres.table(LAW),
        surface=Surface.of(Ground(FLAT, cone)),
        ruts=Ruts.none(),
        bodies=bodies,
        numbers=np.arange(2, 8),
        treads=np.zeros((6, 4)),
        output=np.zeros((6, len(Wheels._fields))),
        timestep=DT,
    )
    wheel_step(kernel)
    column = np.rint((bodies.positions[2:, 0] + 10.0) / 0.1).astype(int)
    row = np.rint((bodies.positions[2:, 1] + 10.0) / 0.1).astype(int)
    np.testing.assert_array_equal(Wheels(*kernel.output.T).cone_index, cone[row, column])
