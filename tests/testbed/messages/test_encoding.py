"""Messages made in batches say what protobuf reads in them."""

import math

import mujoco
import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from proving_ground.testbed.geodesy import ORIGIN_DEG, MapFrame
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.messages.encoding import (
    encode_poses,
    fix_template,
    quaternions,
    single,
    transforms_template,
)
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.vehicle import read_vehicle

TIMES_NS = np.array(
    [0, 1, 40_000_000, 10**9, 127 * 10**9 + 999_999_999, 128 * 10**9, 20_000 * 10**9 + 127]
)


def rotated(quaternion, vector):
    turned = np.zeros(3)
    mujoco.mju_rotVecQuat(turned, np.array(vector, float), np.array(quaternion))
    return turned


def test_transforms_have_their_times_and_their_poses_in_single_precision():
    rng, names = np.random.default_rng(2), ("tractor", "a" * 150)
    poses = single(rng.normal(size=(len(TIMES_NS), 2, 7)))
    messages = transforms_template(names).fill(poses.reshape(-1, 14), TIMES_NS)
    for data, time_ns, bodies in zip(messages, TIMES_NS.tolist(), poses, strict=True):
        transforms = FrameTransforms.FromString(data.tobytes()).transforms
        for transform, name, pose in zip(transforms, names, bodies.tolist(), strict=True):
            at, by = transform.translation, transform.rotation
            assert transform.timestamp.ToNanoseconds() == time_ns
            assert (transform.parent_frame_id, transform.child_frame_id) == ("map", name)
            assert [at.x, at.y, at.z, by.w, by.x, by.y, by.z] == pose


def test_attitudes_are_yaw_then_pitch_then_roll():
    poses = np.random.default_rng(3).uniform(-1.0, 1.0, size=(len(TIMES_NS), 6))
    for data, time_ns, pose in zip(
        encode_poses(TIMES_NS, poses), TIMES_NS.tolist(), poses.tolist(), strict=True
    ):
        message = PoseInFrame.FromString(data.tobytes())
        assert message.timestamp.ToNanoseconds() == time_ns
        turn = message.pose.orientation
        yaw, pitch, roll = pose[3:]
        quat = (turn.w, turn.x, turn.y, turn.z)
        ahead = [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), -math.sin(pitch)]
        np.testing.assert_allclose(rotated(quat, [1, 0, 0]), ahead, atol=1e-6)
        assert rotated(quat, [0, 1, 0])[2] == pytest.approx(math.cos(pitch) * math.sin(roll))
    np.testing.assert_allclose(np.linalg.norm(quaternions(poses), axis=1), 1.0)


def test_a_fix_lies_where_the_ellipsoid_says():
    at = MapFrame().degrees(np.array([[40.0, 30.0]]))
    (data,) = fix_template("tractor").fill(at, np.array([127 * 10**9 + 5]))
    fix = LocationFix.FromString(data.tobytes())
    assert (fix.frame_id, fix.timestamp.ToNanoseconds()) == ("tractor", 127 * 10**9 + 5)
    north, east = fix.latitude - ORIGIN_DEG[0], fix.longitude - ORIGIN_DEG[1]
    # Length of a degree at 50.86 deg north: series of the WGS 84 ellipsoid (NIMA TR8350.2).
    phi = math.radians(ORIGIN_DEG[0])
    degree_north = 111132.954 - 559.822 * math.cos(2 * phi) + 1.175 * math.cos(4 * phi)
    degree_east = 111412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi)
    assert north * degree_north == pytest.approx(30.0, abs=1e-3)
    assert east * degree_east == pytest.approx(40.0, abs=1e-3)


def test_the_scene_shows_every_body_and_the_ground():
    plant = Plant(read_vehicle("kayacan2016"), flat(), SoilMap(600.0))
    ground, *bodies = SceneUpdate.FromString(plant.scenery.shapes).entities
    assert [body.frame_id for body in bodies] == list(plant.body_names[1:])
    (field,) = ground.triangles
    points = np.array([[point.x, point.y] for point in field.points])
    assert points.min(axis=0).tolist() == [-40.0, -25.0]
    assert points.max(axis=0).tolist() == [40.0, 25.0]
    assert len(field.colors) == len(field.points) <= 35_000
    corners = points[np.array(field.indices)].reshape(-1, 3, 2)
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = 0.5 * (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0])
    assert areas.min() > 0.0, "every triangle faces the sky"
    assert areas.sum() == pytest.approx(80.0 * 50.0)
    again = mujoco.MjModel.from_xml_string(plant.mjcf)  # the model in a log
    assert (again.hfield_nrow[0], again.hfield_ncol[0]) == plant.terrain.heights.shape
    assert [again.body(i).name for i in range(again.nbody)] == list(plant.body_names)
