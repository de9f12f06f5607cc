"""Examples of README and the pages, run as they stand there.

A block whose first line is a comment with a file name is that file. Of the others, each line of a
bash block is a command of `ttempc`, a python block is run, and a text block is what the python
block above it prints. A page has one folder and one namespace.
"""

import contextlib
import io
import re
import shlex
import socket
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from proving_ground.experiments.commands import drive
from proving_ground.experiments.commands.cli import main

from ttempc import Vehicle, straight
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
BLOCK_OF_ROS = "# guidance_node.py"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILE = re.compile(r"# ([\w-]+\.\w+)\n")
PAGES = [
    page
    for page in (ROOT / "README.md", *sorted(DOCS.glob("*.md")))
    if BLOCK.search(page.read_text())
]
EXPECTED_CODE = re.compile(r"(.*?)(?: \|\| test \$\? = (\d))?")


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    """Stand in an empty folder, from which modules are imported, and leave no module of it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    plt.switch_backend("agg")
    yield
    plt.close("all")
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").is_relative_to(tmp_path):
            del sys.modules[name]


def run_commands(code):
    for line in code.replace("\\\n", " ").splitlines():
        command, expected = EXPECTED_CODE.fullmatch(line).groups()
        program, *words = shlex.split(command)
        assert program == "ttempc"
        assert main(words) == int(expected or 0), line


def run_python(code, names):
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        exec(compile(code, "<example>", "exec"), names)
    return output.getvalue()


def numbers(text):
    return [float(number) for number in re.findall(r"-?\d+(?:\.\d+)?", text)]


def assert_same_text(output, expected):
    """Assert equal words and nearly equal numbers: another processor may round otherwise."""
    assert re.sub(r"[-\d.]+", "", output) == re.sub(r"[-\d.]+", "", expected)
    assert numbers(output) == pytest.approx(numbers(expected), abs=0.1)


@pytest.fixture
def free_port(monkeypatch):
    """A free UDP port in the place of the default one of `serve`, which may be taken."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        port = link.getsockname()[1]
    monkeypatch.setitem(drive._PORTS, "json", port)
    return str(port)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_examples_of_a_page_run(page, tmp_path, free_port):
    text = page.read_text().replace("8890", free_port)
    names = {"__name__": "__main__"}
    output = ""
    for language, code in BLOCK.findall(text):
        file = FILE.match(code)
        if file:
            (tmp_path / file[1]).write_text(code)
        elif language == "bash":
            run_commands(code)
        elif language == "python":
            output = run_python(code, names)
        else:
            assert language == "text", f"a block of {language} names no file"
            assert_same_text(output, code)


def stub_of_ros(monkeypatch, clock):
    """Put modules in the place of ROS 2 that call a node's callbacks by hand."""

    class Node:
        def __init__(self, name):
            self.callbacks, self.published = {}, []

        def create_subscription(self, message, topic, callback, depth):
            self.callbacks[topic] = callback

        def create_publisher(self, message, topic, depth):
            return SimpleNamespace(publish=self.published.append)

        def create_timer(self, period_s, callback):
            self.tick = callback

        def get_clock(self):
            return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=clock()))

        def get_logger(self):
            return SimpleNamespace(warning=self.fail, info=lambda text: None)

        def fail(self, text):
            raise AssertionError(text)

    modules = {
        "rclpy": {},
        "rclpy.node": {"Node": Node},
        "geometry_msgs.msg": {"PointStamped": SimpleNamespace},
        "sensor_msgs.msg": {"JointState": SimpleNamespace},
    }
    for name, content in modules.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)


def test_the_ros_node_brings_a_vehicle_onto_its_path(monkeypatch, tmp_path):
    """Units, names and stamps of the messages: a swapped sign or angle drives the vehicle away."""
    blocks = (code for _, code in BLOCK.findall((DOCS / "integrations.md").read_text()))
    (code,) = (code for code in blocks if code.startswith(BLOCK_OF_ROS))
    nanoseconds = 1_763_775_600_000_000_000
    stub_of_ros(monkeypatch, lambda: nanoseconds)
    (tmp_path / "guidance_node.py").write_text(code)
    import guidance_node

    vehicle, radius_m = Vehicle(), guidance_node.REAR_WHEEL_RADIUS_M
    node = guidance_node.GuidanceNode(vehicle, straight(30.0))
    node.tick()
    assert not node.published  # nothing is driven before there are positions
    state = node.guidance.reference.at(0.0).state.copy()
    state[1] += 0.3  # [m] to the left of the path
    while not node.guidance.finished:
        stamp = SimpleNamespace(
            sec=nanoseconds // 1_000_000_000, nanosec=nanoseconds % 1_000_000_000
        )
        header = SimpleNamespace(stamp=stamp)
        for topic, (x, y) in {
            "tractor/position": state[:2],
            "trailer/position": trailer_point(state, vehicle),
        }.items():
            point = SimpleNamespace(x=x, y=y, z=0.0)
            node.callbacks[topic](SimpleNamespace(header=header, point=point))
        node.callbacks["joint_states"](
            SimpleNamespace(
                header=header,
                name=["front_steering", "trailer_steering", "hitch", "rear_wheel"],
                position=[state[4], state[5], hitch_angle(state), 0.0],
                velocity=[0.0, 0.0, 0.0, state[6] / radius_m],
            )
        )
        node.tick()
        command = node.published[-1]
        assert command.name == ["front_steering", "trailer_steering", "hydrostat"]
        for _ in range(20):
            state = state + 0.01 * articulated(state, np.array(command.position), vehicle)
        nanoseconds += 200_000_000
    assert abs(state[1]) < 0.02
    assert state[0] == pytest.approx(
        node.guidance.reference.at(node.guidance.reference.duration_s).state[0], abs=0.1
    )
    node.tick()
    assert node.published[-1].position[2] == 0.0  # at the end the vehicle stops
