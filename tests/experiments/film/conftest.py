"""Log, replay and ground of the tests of films."""

import mujoco
import numpy as np
import pytest
from proving_ground.experiments.film.replay import read_replay
from proving_ground.testbed.ground.terrain import Terrain


@pytest.fixture(scope="module")
def log(short_runs):
    return short_runs / "nominal" / "log.mcap"


@pytest.fixture(scope="module")
def replay(log):
    return read_replay(log)


@pytest.fixture
def bumps():
    return Terrain(np.random.default_rng(4).normal(size=(101, 161)), 0.1, (-8.0, -5.0))


def compiled_with(field):
    """Return a compiled model of nothing but a ground and the meshes of a field."""
    spec = mujoco.MjSpec()
    spec.add_hfield(name="ground", nrow=2, ncol=2, size=[1, 1, 1, 1], userdata=[0.0] * 4)
    spec.worldbody.add_geom(name="ground", type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="ground")
    for name in ("ground", "meadow"):
        spec.add_material(name=name)
    field.add_to(spec)
    return spec.compile()
