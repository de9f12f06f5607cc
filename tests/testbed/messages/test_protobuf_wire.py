"""Packed messages are equal to those that protobuf writes."""

import math

import mujoco
import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.LocationFix_pb2 import LocationFix
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from proving_ground.testbed.geodesy import DATUM
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.terrain import flat
from proving_ground.testbed.messages.protobuf_wire import TransformsEncoder, single
from proving_ground.testbed.messages.viewer_messages import (
    encode_fix,
    encode_paths,
    encode_poses,
    quaternion,
)
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.truth import WHEELS, Pose
from proving_ground.testbed.vehicle.vehicle import read_vehicle

TIMES_NS = (0, 1, 40_000_000, 10**9, 127 * 10**9 + 999_999_999, 128 * 10**9, 20_000 * 10**9 + 127)


def in_body(pose, point):
    """Return a point of a shape in the frame of its body."""
    turned, turn = np.zeros(3), pose.orientation
    quaternion = np.array([turn.w, turn.x, turn.y, turn.z])
    mujoco.mju_rotVecQuat(turned, np.array([point.x, point.y, point.z]), quaternion)
    return turned + np.array([pose.position.x, pose.position.y, pose.position.z])


def test_transforms_are_protobufs_own_bytes():
    rng = np.random.default_rng(2)
    encoder = TransformsEncoder("map", ("tractor", "a" * 150))
    xyz, quat = rng.normal(size=(len(TIMES_NS), 2, 3)), rng.normal(size=(len(TIMES_NS), 2, 4))
    messages = encoder.encode(TIMES_NS, xyz, quat)
    for data, time_ns, places, turns in zip(messages, TIMES_NS, xyz, quat, strict=True):
        message = FrameTransforms.FromString(data)
        assert message.SerializeToString() == data
        for transform, place, turn in zip(message.transforms, places, turns, strict=True):
            stamp, at, by = transform.timestamp, transform.translation, transform.rotation
            assert stamp.seconds * 10**9 + stamp.nanos == time_ns
            assert [at.x, at.y, at.z] == single(place).tolist()
            assert [by.w, by.x, by.y, by.z] == single(turn).tolist()


def test_bodies_may_be_none():
    encoder = TransformsEncoder("map", ())
    assert encoder.encode([5, 6], np.zeros((2, 0, 3)), np.zeros((2, 0, 4))) == [b"", b""]


def test_poses_are_protobufs_own_bytes():
    places = [Pose(1.0, 2.0, 3.0, 0.4, 0.1, -0.2 * i) for i in range(len(TIMES_NS))]
    for data, time_ns, place in zip(encode_poses(TIMES_NS, places), TIMES_NS, places, strict=True):
        message = PoseInFrame.FromString(data)
        assert message.SerializeToString() == data
        assert message.timestamp.ToNanoseconds() == time_ns
        turn = message.pose.orientation
        assert [turn.w, turn.x, turn.y, turn.z] == pytest.approx(quaternion(place), abs=1e-7)
        assert math.hypot(turn.w, turn.x, turn.y, turn.z) == pytest.approx(1.0, abs=1e-6)


def test_paths_made_together_are_those_made_alone():
    lines = [np.eye(3), np.ones((1, 3)), np.arange(12.0).reshape(4, 3)]
    together = encode_paths(TIMES_NS[:3], lines)
    alone = zip(TIMES_NS[:3], lines, strict=True)
    assert together == [encode_paths([time_ns], [line])[0] for time_ns, line in alone]
    for data, line, time_ns in zip(together, lines, TIMES_NS[:3], strict=True):
        path = PosesInFrame.FromString(data)
        assert path.frame_id == "map"
        assert path.timestamp.ToNanoseconds() == time_ns
        assert [pose.position.y for pose in path.poses] == line[:, 1].tolist()


def test_a_fix_lies_where_the_ellipsoid_says():
    data = encode_fix(127 * 10**9 + 5, "tractor", 40.0, 30.0)
    fix = LocationFix.FromString(data)
    assert fix.SerializeToString() == data
    assert (fix.frame_id, fix.timestamp.ToNanoseconds()) == ("tractor", 127 * 10**9 + 5)
    north, east = fix.latitude - DATUM.latitude_deg, fix.longitude - DATUM.longitude_deg
    # Length of a degree at 50.86 deg north: series of the WGS 84 ellipsoid (NIMA TR8350.2).
    phi = math.radians(DATUM.latitude_deg)
    degree_north = 111132.954 - 559.822 * math.cos(2 * phi) + 1.175 * math.cos(4 * phi)
    degree_east = 111412.84 * math.cos(phi) - 93.5 * math.cos(3 * phi) + 0.118 * math.cos(5 * phi)
    assert north * degree_north == pytest.approx(30.0, abs=1e-3)
    assert east * degree_east == pytest.approx(40.0, abs=1e-3)


def test_the_scene_shows_every_body_and_the_ground():
    plant = Plant(read_vehicle("kayacan2016"), flat(), SoilMap(600.0))
    scene = SceneUpdate.FromString(plant.scenery.shapes)
    ground, *bodies = scene.entities
    assert [body.frame_id for body in bodies] == list(plant.body_names[1:])
    assert all(entity.frame_locked for entity in scene.entities)
    by_name = {body.id: body for body in bodies}
    for wheel in WHEELS:
        (tyre,) = by_name[wheel].triangles
        assert max(tyre.indices) == len(tyre.points) - 1
        places = np.array([in_body(tyre.pose, point) for point in tyre.points])
        radius = float(plant.tyres.radius[WHEELS.index(wheel)])
        assert np.hypot(places[:, 0], places[:, 2]).max() == pytest.approx(radius, rel=0.005)
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


def test_the_model_in_a_log_is_that_of_the_plant():
    plant = Plant(read_vehicle("kayacan2016"), flat(), SoilMap(600.0))
    again = mujoco.MjModel.from_xml_string(plant.mjcf)
    assert (again.hfield_nrow[0], again.hfield_ncol[0]) == plant.terrain.heights.shape
    assert [again.body(i).name for i in range(again.nbody)] == list(plant.body_names)
