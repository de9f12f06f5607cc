"""Exports of logs, read by the tools that they are for: ROS 2, layouts of viewers."""

import importlib
import json
import re
from collections import defaultdict
from math import atan2
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from proving_ground.experiments import logs
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.run.run_folder import run
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.geodesy import MapFrame
from proving_ground.testbed.log.reader import read_content, read_log
from proving_ground.testbed.log.scene import lines_of
from proving_ground.testbed.messages.publisher import topics_of
from proving_ground.testbed.recording.channels import CHANNELS, ERROR, PREDICTED_PATH_TOPIC

LAYOUTS = Path(logs.__file__).parent
FIELDS = {(each.topic, name) for each in (*CHANNELS, ERROR) for name in each.fields}


def test_what_cannot_be_exported_is_refused_in_one_line(short_runs, tmp_path, monkeypatch, capsys):
    log = str(short_runs / "nominal" / "log.mcap")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["log", "export", log, "--format", "parquet", "-o", str(tmp_path / "new")]) == 2
    error = capsys.readouterr().err
    assert "pip install -e '.[export]'" in error
    assert error.count("\n") == 1
    assert not any(tmp_path.iterdir())


def test_the_layouts_of_viewers_name_topics_and_fields_of_a_log():
    text = (LAYOUTS / "foxglove-layout.json").read_text(encoding="utf-8")
    topics = set(re.findall(r'"(/[\w/]+)(?:\.(\w+))?"', text))
    plotted = {pair for pair in topics if pair[1]}
    assert len(plotted) > 30
    assert plotted <= FIELDS
    assert {topic for topic, _ in topics} <= {each.name for each in topics_of()}
    json.loads(text)
    tree = ElementTree.parse(LAYOUTS / "plotjuggler-layout.xml")
    curves = {tuple(each.attrib["name"].rsplit("/", 1)) for each in tree.iter("curve")}
    assert len(curves) > 30
    assert curves <= FIELDS


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """Record of a run with late samples, and the messages of its bag: log time [s], message."""
    pytest.importorskip("rosbags")
    folder = tmp_path_factory.mktemp("bag")
    straight = "path={kind='straight', length_m=6}"
    run(*load("grass", [straight, "sensors.preset=field"]), 3, folder / "run")
    recipes = str(Path(__file__).parents[3] / "docs" / "examples")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(recipes)
        importlib.import_module("ros2_bag").convert(folder / "run" / "log.mcap", folder / "bag")
    topics = defaultdict(list)
    with (folder / "bag" / "bag.mcap").open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for _, channel, message, decoded in reader.iter_decoded_messages():
            topics[channel.topic].append((1e-9 * message.log_time, decoded))
    return folder / "run" / "log.mcap", read_log(folder / "run" / "log.mcap"), topics


def stamp_s(message):
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def yaw(turn):
    return atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))


def test_a_bag_has_the_truth_of_the_record(bag):
    _, record, topics = bag
    state = record["/state"]
    for place, letter in (("tractor", "t"), ("trailer", "i")):
        messages = [message for _, message in topics[f"/{place}/odometry"]]
        assert [stamp_s(m) for m in messages] == pytest.approx(state.time_s.tolist())
        places = [m.pose.pose.position for m in messages]
        names = [f"{axis}_{letter}_m" for axis in "xyz"]
        np.testing.assert_array_equal([(p.x, p.y, p.z) for p in places], state.columns(*names))
        yaws = [yaw(m.pose.pose.orientation) for m in messages]
        np.testing.assert_allclose(yaws, state[f"psi_{letter}_rad"], atol=1e-9)
        rates = [m.twist.twist.angular.z for m in messages]
        np.testing.assert_array_equal(rates, state[f"yaw_rate_{letter}_radps"])
    speeds = [m.twist.twist.linear.x for m in messages]  # of the trailer
    driven = np.hypot(*np.diff(state.columns("x_i_m", "y_i_m"), axis=0).T).sum()
    assert np.trapezoid(speeds, state.time_s) == pytest.approx(driven, rel=1e-3)


def test_samples_of_a_bag_are_stamped_when_taken_and_logged_when_delivered(bag):
    _, record, topics = bag
    for place in ("tractor", "trailer"):
        table, name = record["/measurement"], f"gnss_{place}"
        kept = ~np.isnan(table[f"{name}_time_s"])
        points = table.columns(f"{name}_x_m", f"{name}_y_m")[kept]
        taken_s, delivered_s = table[f"{name}_time_s"][kept], table.time_s[kept]
        assert (delivered_s > taken_s).all()  # the receivers of this preset are late
        messages = topics[f"/{place}/position"]
        np.testing.assert_array_equal([(m.point.x, m.point.y) for _, m in messages], points)
        assert [stamp_s(m) for _, m in messages] == pytest.approx(taken_s.tolist())
        assert [time_s for time_s, _ in messages] == pytest.approx(delivered_s.tolist())
        fixes = [m for _, m in topics[f"/{place}/fix"]]
        back = MapFrame().points([m.latitude for m in fixes], [m.longitude for m in fixes])
        np.testing.assert_allclose(back, points, atol=1e-3)


def test_a_bag_has_references_commands_paths_and_events(bag):
    log, record, topics = bag
    reference = [(m.pose.position.x, m.pose.position.y) for _, m in topics["/trailer/reference"]]
    np.testing.assert_array_equal(reference, record["/reference"].columns("x_i_m", "y_i_m"))
    names = ("delta_t_rad_command", "delta_i_rad_command", "hp_command")
    commands = [list(m.position) for _, m in topics["/commands"]]
    np.testing.assert_array_equal(commands, record["/control"].columns(*names))
    paths = [message for _, message in topics["/mpc/predicted_path"]]
    lines = lines_of(read_content(log), PREDICTED_PATH_TOPIC)
    for line, path in zip(lines, paths, strict=True):
        points = [pose.pose.position for pose in path.poses]
        np.testing.assert_array_equal([(p.x, p.y, p.z) for p in points], line.points)
    assert [m.msg for _, m in topics["/rosout"]] == [event.text for event in record.events]
