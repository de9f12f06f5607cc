"""Logs as rosbag2 files, read by mcap-ros2-support and rosbags: readers that are not ours."""

import importlib.util
from collections import defaultdict
from math import atan2

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.geodesy import DATUM, east_north
from proving_ground.testbed.log.reader import read_content, read_log
from proving_ground.testbed.log.scene import lines_of
from proving_ground.testbed.recording.channels import (
    CONTROL,
    ESTIMATE,
    MEASUREMENT,
    PREDICTED_PATH_TOPIC,
    REFERENCE,
    STATE,
)
from rosbags.highlevel import AnyReader

REAR_WHEEL_RADIUS_M = 0.40  # mjcf/vehicles/kayacan2016.toml


EXPORT = ("log", "export", "--format", "ros2")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Record and rosbag2 file of a run with every sensor, late samples and predicted paths."""
    folder = tmp_path_factory.mktemp("bag")
    straight = "path={kind='straight', length_m=6}"
    simulate(*load("grass", [straight, "sensors.preset=field"]), 3, log=folder / "log.mcap")
    assert main([*EXPORT, str(folder / "log.mcap"), "-o", str(folder / "bag.mcap")]) == 0
    return read_log(folder / "log.mcap"), folder / "bag.mcap"


@pytest.fixture(scope="module")
def decoded(bag):
    """Messages by topic, as mcap-ros2-support decodes them: log time [s], message."""
    topics = defaultdict(list)
    with bag[1].open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics[channel.topic].append((1e-9 * message.log_time, decoded))
    return topics


def stamp_s(header):
    return header.stamp.sec + 1e-9 * header.stamp.nanosec


def samples(record, sensor, parts):
    """Return the samples of a sensor, their own times and those of their delivery."""
    table = record[MEASUREMENT]
    taken = table[f"{sensor}_time_s"]
    kept = ~np.isnan(taken)
    names = [f"{sensor}_{part}" for part in parts]
    return table.columns(*names)[kept], taken[kept], table.time_s[kept]


def yaw(turn):
    return atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def test_file_is_one_of_ros_2_with_definitions(bag):
    with bag[1].open("rb") as stream:
        reader = make_reader(stream)
        assert reader.get_header().profile == "ros2"
        summary = reader.get_summary()
    assert {schema.encoding for schema in summary.schemas.values()} == {"ros2msg"}
    assert {channel.message_encoding for channel in summary.channels.values()} == {"cdr"}


def test_rosbags_reads_every_message(bag, decoded):
    with AnyReader([bag[1]]) as reader:
        counts = {item.topic: item.msgcount for item in reader.connections}
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
    assert counts == {topic: len(messages) for topic, messages in decoded.items()}


@pytest.mark.parametrize(("place", "letter"), [("tractor", "t"), ("trailer", "i")])
def test_true_odometry_is_that_of_the_record(bag, decoded, place, letter):
    state, messages = bag[0][STATE], decoded[f"/{place}/odometry"]
    assert [stamp_s(m.header) for _, m in messages] == pytest.approx(state.time_s.tolist())
    assert {m.header.frame_id for _, m in messages} == {"map"}
    places = [m.pose.pose.position for _, m in messages]
    names = [f"{axis}_{letter}_m" for axis in "xyz"]
    np.testing.assert_array_equal([(p.x, p.y, p.z) for p in places], state.columns(*names))
    yaws = [yaw(m.pose.pose.orientation) for _, m in messages]
    np.testing.assert_allclose(yaws, state[f"psi_{letter}_rad"], atol=1e-9)
    rates = [m.twist.twist.angular.z for _, m in messages]
    np.testing.assert_array_equal(rates, state[f"yaw_rate_{letter}_radps"])


def test_twist_of_the_tractor_is_recorded_and_that_of_the_trailer_follows_its_path(bag, decoded):
    state = bag[0][STATE]
    speeds = [
        (m.twist.twist.linear.x, m.twist.twist.linear.y) for _, m in decoded["/tractor/odometry"]
    ]
    np.testing.assert_array_equal(speeds, state.columns("v_mps", "v_lateral_mps"))
    trailer = [m.twist.twist.linear for _, m in decoded["/trailer/odometry"]]
    driven = np.hypot(*np.diff(state.columns("x_i_m", "y_i_m"), axis=0).T).sum()
    along = np.trapezoid([v.x for v in trailer], state.time_s)
    assert along == pytest.approx(driven, rel=1e-3)
    assert max(abs(v.y) for v in trailer) < 0.2  # it rolls forward, on its wheels


def test_frames_of_both_points_are_those_of_the_odometry(decoded):
    odometry = {stamp_s(m.header): m.pose.pose for _, m in decoded["/tractor/odometry"]}
    for _, message in decoded["/tf"]:
        frames = {each.child_frame_id: each for each in message.transforms}
        assert {"base_link", "trailer_link", "tractor", "trailer"} <= set(frames)
        assert {each.header.frame_id for each in message.transforms} == {"map"}
        base = frames["base_link"]
        pose = odometry[stamp_s(base.header)]
        origin = base.transform.translation
        assert (origin.x, origin.y, origin.z) == (pose.position.x, pose.position.y, pose.position.z)


def test_estimate_has_the_covariance_of_the_record_or_an_unknown_one(bag, decoded):
    estimate, messages = bag[0][ESTIMATE], decoded["/tractor/odometry/estimated"]
    np.testing.assert_array_equal([m.twist.twist.linear.x for _, m in messages], estimate["v_mps"])
    diagonals = [np.reshape(m.pose.covariance, (6, 6)).diagonal()[[0, 1, 5]] for _, m in messages]
    sds = estimate.columns("sd_x_t_m", "sd_y_t_m", "sd_psi_t_rad")
    np.testing.assert_allclose(diagonals, sds**2)
    trailer = [m for _, m in decoded["/trailer/odometry/estimated"]]
    points = [(m.pose.pose.position.x, m.pose.pose.position.y) for m in trailer]
    np.testing.assert_array_equal(points, estimate.columns("x_i_m", "y_i_m"))
    assert {m.pose.covariance[0] for m in trailer} == {-1.0}


@pytest.mark.parametrize("place", ["tractor", "trailer"])
def test_positions_are_stamped_when_taken_and_logged_when_delivered(bag, decoded, place):
    points, taken_s, delivered_s = samples(bag[0], f"gnss_{place}", ("x_m", "y_m"))
    assert (delivered_s > taken_s).all()  # the receivers of this preset are late
    messages = decoded[f"/{place}/position"]
    np.testing.assert_array_equal([(m.point.x, m.point.y) for _, m in messages], points)
    assert [stamp_s(m.header) for _, m in messages] == pytest.approx(taken_s.tolist())
    assert [time_s for time_s, _ in messages] == pytest.approx(delivered_s.tolist())
    fixes = [m for _, m in decoded[f"/{place}/fix"]]
    origin = (DATUM.latitude_deg, DATUM.longitude_deg)
    back = east_north([m.latitude for m in fixes], [m.longitude for m in fixes], origin)
    np.testing.assert_allclose(back, points, atol=1e-3)


def test_joint_states_are_the_samples_of_angles_and_wheel(bag, decoded):
    columns = defaultdict(list)
    for _, message in decoded["/joint_states"]:
        for name, angle, rate in zip(message.name, message.position, message.velocity, strict=True):
            columns[name].append(rate * REAR_WHEEL_RADIUS_M if name == "rear_wheel" else angle)
    for name, sensor, part in (
        ("front_steering", "steering_tractor", "rad"),
        ("trailer_steering", "steering_trailer", "rad"),
        ("hitch", "hitch", "rad"),
        ("rear_wheel", "encoder", "mps"),
    ):
        values, _, _ = samples(bag[0], sensor, (part,))
        np.testing.assert_allclose(columns[name], values[:, 0], rtol=1e-14)


def test_imu_has_the_rate_and_the_tilt_of_the_sample(bag, decoded):
    values, _, _ = samples(bag[0], "imu_trailer", ("yaw_rate_radps", "roll_rad", "pitch_rad"))
    messages = [m for _, m in decoded["/trailer/imu"]]
    np.testing.assert_array_equal([m.angular_velocity.z for m in messages], values[:, 0])
    half = [(m.orientation.x, m.orientation.y) for m in messages]
    np.testing.assert_allclose(half, 0.5 * values[:, 1:], atol=1e-4)  # small angles


def test_reference_commands_paths_and_events_are_there(bag, decoded):
    record = bag[0]
    reference = [(m.pose.position.x, m.pose.position.y) for _, m in decoded["/trailer/reference"]]
    np.testing.assert_array_equal(reference, record[REFERENCE].columns("x_i_m", "y_i_m"))
    commands = [list(m.position) for _, m in decoded["/commands"]]
    names = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
    np.testing.assert_array_equal(commands, record[CONTROL].columns(*names))
    ((_, path),) = decoded["/reference/path"]
    assert path.poses[0].pose.position.x == pytest.approx(record[REFERENCE]["x_t_m"][0], abs=1e-5)
    predicted = lines_of(read_content(bag[1].with_name("log.mcap")), PREDICTED_PATH_TOPIC)
    paths = [message for _, message in decoded["/mpc/predicted_path"]]
    for line, path in zip(predicted, paths, strict=True):
        points = [pose.pose.position for pose in path.poses]
        np.testing.assert_array_equal([(p.x, p.y, p.z) for p in points], line.points)
    assert [m.msg for _, m in decoded["/rosout"]] == [event.text for event in record.events]


def test_what_cannot_be_written_is_refused_in_a_line(bag, capsys, monkeypatch, tmp_path):
    log = str(bag[1].with_name("log.mcap"))
    assert main([*EXPORT, log, "-o", str(bag[1])]) == 2
    assert "exists already" in capsys.readouterr().err
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main([*EXPORT, log, "-o", str(tmp_path / "new.mcap")]) == 2
    assert "pip install 'ttempc-proving-ground[ros2]'" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
