"""Scene of a log: equal to the logged scene, to the stated precision."""

import numpy as np
import pytest
from proving_ground.testbed.ground.ground import GROUND_FILE, Ground
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.log.reader import read_content
from proving_ground.testbed.log.scene import attachment, ground_of, lines_of, motion_of
from proving_ground.testbed.log.writer import LogWriter
from proving_ground.testbed.messages.scenery import Scenery
from proving_ground.testbed.recording.channels import REFERENCE_PATH_TOPIC

from tests.testbed.truths import moments, truth

BODIES = ("tractor", "trailer")


@pytest.fixture(scope="module")
def ground():
    rng = np.random.default_rng(5)
    terrain = Terrain(rng.normal(size=(30, 40)), 0.1, (-2.0, -1.5))
    return Ground(terrain, rng.uniform(200.0, 900.0, size=(30, 40)))


def log(path, ground, scenes):
    path.unlink(missing_ok=True)
    attachments = {"model.xml": "<mujoco/>", GROUND_FILE: ground.to_npz()}
    scenery = Scenery(BODIES, ground)
    with LogWriter(path, metadata={}, attachments=attachments, scenery=scenery) as writer:
        writer.path(REFERENCE_PATH_TOPIC, 0.0, np.array([[0.0, 0.0], [1.0, 0.5]]))
        writer.scenes(moments(*scenes))
    return read_content(path)


def test_ground_and_motion_come_back(ground, tmp_path):
    rng = np.random.default_rng(6)
    scenes = [
        truth(time_s=0.04 * k, body_xyz=rng.normal(size=(2, 3)), body_quat=rng.normal(size=(2, 4)))
        for k in range(10)
    ]
    content = log(tmp_path / "log.mcap", ground, scenes)
    logged_ground = ground_of(content)
    assert logged_ground.terrain.spacing_m == ground.terrain.spacing_m
    assert logged_ground.terrain.origin == ground.terrain.origin
    np.testing.assert_allclose(logged_ground.terrain.heights, ground.terrain.heights, rtol=1e-7)
    np.testing.assert_allclose(logged_ground.cone_index, ground.cone_index, rtol=1e-7)
    motion = motion_of(content)
    assert motion.body_names == BODIES
    np.testing.assert_allclose(motion.time_s, [scene.time_s for scene in scenes], atol=1e-9)
    np.testing.assert_allclose(motion.xyz, [scene.body_xyz for scene in scenes], rtol=1e-6)
    np.testing.assert_allclose(motion.quat, [scene.body_quat for scene in scenes], rtol=1e-6)
    (line,) = lines_of(content, REFERENCE_PATH_TOPIC)
    np.testing.assert_allclose(line.points[:, :2], [[0.0, 0.0], [1.0, 0.5]], rtol=1e-6)
    assert lines_of(content, "/mpc/predicted_path") == []
    assert attachment(content, "model.xml") == b"<mujoco/>"
