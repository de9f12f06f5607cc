from collections import Counter

import mujoco
import numpy as np
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.appearance import tyre_mesh
from proving_ground.testbed.vehicle.vehicle import read_vehicle


def test_tyre_mesh_is_closed_and_faces_outwards():
    vertices, faces = tyre_mesh(0.4, 0.24, 0.18)
    edges = Counter(
        (int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True)
    )
    assert all(count == 1 and (b, a) in edges for (a, b), count in edges.items())
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    volume = np.einsum("ni,ni->n", a, np.cross(b, c)).sum() / 6.0
    ring = np.pi * (0.4**2 - 0.22**2) * 0.24
    assert 0.6 * ring < volume < ring
    reach = np.hypot(vertices[:, 0], vertices[:, 2])
    assert 0.39 < reach.max() <= 0.4


def test_drawn_model_moves_as_the_physics_does():
    plant = Plant(read_vehicle(), terrain.flat((20.0, 12.0)), SoilMap(600.0))
    truth = plant.reset(0.0, 0.0, 0.5, 1.0)
    drawn = plant.drawn_model()
    assert [drawn.body(i).name for i in range(drawn.nbody)] == list(plant.body_names)
    assert drawn.nq == plant.model.nq
    np.testing.assert_allclose(drawn.body_mass, plant.model.body_mass, rtol=1e-6)
    inertias = (np.sort(model.body_inertia) for model in (drawn, plant.model))  # any order of axes
    np.testing.assert_allclose(*inertias, rtol=1e-6)
    data = mujoco.MjData(drawn)
    data.qpos[:] = plant.data.qpos
    mujoco.mj_kinematics(drawn, data)
    np.testing.assert_allclose(data.xpos, truth.body_xyz, atol=1e-9)
