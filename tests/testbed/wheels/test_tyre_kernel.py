"""The compiled law of a wheel on soil against its reference."""

from dataclasses import fields

import numpy as np
import pytest
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.truth import Wheels
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.tyre import WheelMotion
from proving_ground.testbed.wheels.tyre_kernel import Output, wheel_step

from tests.testbed.wheels.reference import step

DT = 0.002
FLAT = terrain.flat((20.0, 20.0))
LAW = SoilLaw()


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
    deflection = rng.uniform(-1.0, 1.0, (n, 3)) * np.array([0.15, 0.3, 0.001])
    soil = SoilMap(float(rng.choice([60.0, 300.0, 2000.0])))
    return ground, soil, WheelMotion(centre, axle, velocity, rotation), deflection


def run_kernel(law, tyres, ground, soil, wheels, deflection, in_track=False):
    """Hand the same wheels to the compiled law, as six bodies of a MuJoCo-like state."""
    n = 6
    xpos = np.vstack([np.zeros((2, 3)), wheels.centre])
    xmat = np.zeros((n + 2, 9))
    xmat[2:, [1, 4, 7]] = wheels.axle
    com = np.tile([0.3, -0.2, 0.5], (n + 2, 1))
    cvel = np.zeros((n + 2, 6))
    cvel[2:, :3] = wheels.rotation
    cvel[2:, 3:] = wheels.velocity - np.cross(wheels.rotation, wheels.centre - com[2:])
    state, output, xfrc = deflection.ravel(), np.zeros((n, len(Output))), np.zeros((n + 2, 6))
    # a copy; in a track, every point was driven over 9 m ago
    state = np.concatenate([state, [9.0], np.ones(ground.heights.size)] if in_track else [state])
    wheel_step(
        law.table(),
        tyres.table(law),
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
    return state[: 3 * n].reshape(n, 3), output, xfrc[2:]


def test_the_columns_of_the_report_are_the_fields_of_wheels():
    assert [column.name.lower() for column in Output] == list(Wheels._fields)


def other_law():
    """A law whose coefficients all differ from the default ones, each by its own factor."""
    factors = np.linspace(0.8, 1.2, len(fields(SoilLaw)))
    return SoilLaw(
        **{
            field.name: float(factor * field.default)
            for field, factor in zip(fields(SoilLaw), factors, strict=True)
            if isinstance(field.default, float)
        }
    )


@pytest.mark.parametrize("law", [LAW, SoilLaw(tyre="radial"), other_law()])
def test_compiled_law_is_the_reference_law(tyres, law):
    rng = np.random.default_rng(20161)
    full_scale = 2e4  # [N], [N m]: the largest forces of these cases
    touching = 0
    for case in range(100):
        in_track = case % 4 == 0
        ground, soil, wheels, deflection = random_case(rng, tyres)
        cone_index = np.full(6, soil.background)
        state, forces = step(law, tyres, ground, cone_index, wheels, deflection, DT, in_track)
        state_c, output, xfrc = run_kernel(law, tyres, ground, soil, wheels, deflection, in_track)
        touching += np.count_nonzero(forces.load)
        np.testing.assert_allclose(state_c, state, atol=1e-9 * 0.3, rtol=0)
        np.testing.assert_allclose(xfrc[:, :3], forces.force, atol=1e-9 * full_scale, rtol=0)
        np.testing.assert_allclose(xfrc[:, 3:], forces.moment, atol=1e-9 * full_scale, rtol=0)
        for column in Output:
            expected = getattr(forces, column.name.lower())
            scale = max(1.0, np.abs(expected).max())
            np.testing.assert_allclose(output[:, column], expected, atol=1e-9 * scale, rtol=0)
    assert touching > 150


def test_compiled_law_reads_the_soil_below_each_wheel(tyres):
    cone = np.arange(201 * 201, dtype=float).reshape(201, 201) + 100.0
    state, output, xfrc = np.zeros(18), np.zeros((6, len(Output))), np.zeros((8, 6))
    xpos = np.zeros((8, 3))
    xpos[2:, 0] = np.linspace(-8.0, 8.0, 6)
    xpos[2:, 1] = np.linspace(5.0, -6.0, 6)
    xmat = np.tile(np.eye(3).ravel(), (8, 1))
    grid = np.array([*FLAT.origin, FLAT.spacing_m, DT])
    kernel = (LAW.table(), tyres.table(LAW), FLAT.heights, cone, grid, np.arange(2, 8), xpos, xmat)
    wheel_step(*kernel, np.zeros((8, 6)), np.zeros((8, 3)), state, output, xfrc)
    column = np.rint((xpos[2:, 0] + 10.0) / 0.1).astype(int)
    row = np.rint((xpos[2:, 1] + 10.0) / 0.1).astype(int)
    np.testing.assert_array_equal(output[:, Output.CONE_INDEX], cone[row, column])
