"""The ROS 2 package without ROS: a stand-in of `rclpy`, messages by rosbags' definitions."""

import re
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from ttempc import Vehicle
from ttempc.models.kinematics import articulated, hitch_angle, trailer_point

PACKAGE = Path(__file__).parents[1] / "docs" / "examples" / "ros2" / "ttempc_guidance"
STORE = get_typestore(Stores.ROS2_HUMBLE)
SUCCESS, FAILURE = "success", "failure"
START_NS = 1_763_775_600_000_000_000


def blank(kind):
    """Return a message as the constructor of ROS gives it: zeros, empty texts and lists."""
    values = {}
    for name, (node, detail) in STORE.get_msgdef(kind).fields:
        if node.name == "NAME":
            values[name] = blank(detail)
        elif node.name == "BASE":
            base = detail[0]
            values[name] = "" if base == "string" else base == "bool" if base == "bool" else 0
        else:
            values[name] = []
    return STORE.types[kind](**values)


def serialised(message, kind):
    """Return a message as CDR; a field that the definition does not have is an error."""
    fields = {name for name, _ in STORE.get_msgdef(kind).fields}
    assert set(vars(message)) - {"__msgtype__"} == fields
    for name, value in vars(message).items():
        if isinstance(value, list) and name != "name":
            setattr(message, name, np.array(value, dtype=np.float64))
    return STORE.serialize_cdr(message, kind)


class Ros:
    """What a test sees of the stand-in: parameters, time, callbacks, what was published."""

    def __init__(self, **parameters):
        self.parameters = parameters
        self.nanoseconds = START_NS
        self.callbacks, self.published, self.logged = {}, [], []
        self.active, self.timer = False, None

    def stamp(self):
        stamp = blank("builtin_interfaces/msg/Time")
        stamp.sec, stamp.nanosec = divmod(self.nanoseconds, 1_000_000_000)
        return stamp

    def publish(self, message):
        if self.active:
            self.published.append(message)

    def install(self, monkeypatch):
        """Put modules in the place of ROS 2 whose node talks to this object."""
        ros = self

        class LifecycleNode:
            def __init__(self, name):
                assert re.fullmatch(r"\w+", name)
                self.declared = {}

            def declare_parameter(self, name, value):
                self.declared[name] = ros.parameters.get(name, value)

            def get_parameter(self, name):
                return SimpleNamespace(value=self.declared[name])

            def create_subscription(self, kind, topic, callback, depth):
                ros.callbacks[topic] = callback
                return topic

            def create_service(self, kind, name, callback):
                ros.callbacks[name] = callback
                return name

            def create_lifecycle_publisher(self, kind, topic, depth):
                return SimpleNamespace(publish=ros.publish)

            def create_timer(self, period_s, callback):
                ros.timer = callback

            def destroy_timer(self, timer):
                ros.timer = None

            def destroy_subscription(self, topic):
                del ros.callbacks[topic]

            destroy_service = destroy_subscription

            def destroy_lifecycle_publisher(self, publisher):
                pass

            def get_clock(self):
                now = SimpleNamespace(nanoseconds=ros.nanoseconds, to_msg=ros.stamp)
                return SimpleNamespace(now=lambda: now)

            def get_logger(self):
                return SimpleNamespace(error=ros.logged.append, warning=ros.logged.append)

            def on_activate(self, state):
                ros.active = True
                return SUCCESS

            def on_deactivate(self, state):
                ros.active = False
                return SUCCESS

        answers = SimpleNamespace(SUCCESS=SUCCESS, FAILURE=FAILURE)
        trigger = SimpleNamespace(Request=SimpleNamespace, Response=SimpleNamespace)
        lifecycle = {
            "LifecycleNode": LifecycleNode,
            "LifecycleState": SimpleNamespace,
            "TransitionCallbackReturn": answers,
        }
        modules = {
            "rclpy": {},
            "rclpy.lifecycle": lifecycle,
            "geometry_msgs.msg": {"PointStamped": SimpleNamespace, "TwistStamped": SimpleNamespace},
            "sensor_msgs.msg": {"JointState": lambda: blank("sensor_msgs/msg/JointState")},
            "std_srvs.srv": {"Trigger": trigger},
        }
        for name, content in modules.items():
            module = ModuleType(name)
            vars(module).update(content)
            monkeypatch.setitem(sys.modules, name, module)
        monkeypatch.syspath_prepend(str(PACKAGE))
        for name in ("ttempc_guidance", "ttempc_guidance.guidance_node"):
            monkeypatch.delitem(sys.modules, name, raising=False)
        from ttempc_guidance.guidance_node import GuidanceNode

        return GuidanceNode()


def position(ros, place):
    message = blank("geometry_msgs/msg/PointStamped")
    message.header.stamp = ros.stamp()
    message.point.x, message.point.y = map(float, place)
    return message


def moves(ros, velocity):
    message = blank("geometry_msgs/msg/TwistStamped")
    message.header.stamp = ros.stamp()
    message.twist.linear.x, message.twist.linear.y = velocity
    return message


def joints(ros, state, radius_m):
    message = blank("sensor_msgs/msg/JointState")
    message.header.stamp = ros.stamp()
    message.name = ["front_steering", "trailer_steering", "hitch", "rear_wheel"]
    message.position = [state[4], state[5], hitch_angle(state), 0.0]
    message.velocity = [0.0, 0.0, 0.0, state[6] / radius_m]
    return message


def test_a_node_that_is_configured_and_active_brings_a_vehicle_onto_its_line(monkeypatch):
    """Units, names, signs and stamps: a swapped one drives the vehicle away."""
    ros, vehicle = Ros(waypoints=[0.0, 0.0, 30.0, 0.0]), Vehicle()
    node = ros.install(monkeypatch)
    assert node.on_configure(None) == SUCCESS
    assert ros.timer is None  # nothing is driven before it is active
    assert node.on_activate(None) == SUCCESS
    ros.timer()
    assert not ros.published  # nor before there are positions
    state = node.guidance.reference.at(0.0).state.copy()
    state[1] += 0.3  # [m] to the left of the line
    while not node.guidance.finished:
        ros.callbacks["tractor/position"](position(ros, state[:2]))
        ros.callbacks["trailer/position"](position(ros, trailer_point(state, vehicle)))
        ros.callbacks["joint_states"](joints(ros, state, 0.40))
        ros.timer()
        command = ros.published[-1]
        assert command.name == ["front_steering", "trailer_steering", "hydrostat"]
        for _ in range(20):
            state = state + 0.01 * articulated(state, np.array(command.position), vehicle)
        ros.nanoseconds += 200_000_000
    assert abs(state[1]) < 0.02
    assert not ros.logged
    ros.timer()
    assert ros.published[-1].position[2] == 0.0  # at the end the vehicle stops
    assert serialised(ros.published[-1], "sensor_msgs/msg/JointState")


def test_the_velocity_of_a_receiver_reaches_the_guidance_east_then_north(monkeypatch):
    ros = Ros()
    node = ros.install(monkeypatch)
    node.on_configure(None)
    node.on_activate(None)
    ros.callbacks["trailer/velocity"](moves(ros, (1.0, -0.25)))
    (sample,) = node.samples
    assert sample.sensor == "velocity_trailer"
    assert sample.value[:2] == (1.0, -0.25)


def test_an_inactive_node_sends_a_last_command_without_drive_and_no_more(monkeypatch):
    ros = Ros()
    node = ros.install(monkeypatch)
    node.on_configure(None)
    node.on_activate(None)
    assert node.on_deactivate(None) == SUCCESS
    assert list(ros.published[-1].position) == [0.0, 0.0, 0.0]
    assert ros.timer is None
    assert node.on_cleanup(None) == SUCCESS
    assert node.guidance is None
    assert not ros.callbacks
    assert node.on_configure(None) == SUCCESS  # once more


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"waypoints": [0.0, 0.0, 1.0]}, "reshape"),
        ({"waypoints": [0.0, 0.0, 10.0, 0.0, 0.0, 0.1]}, "path"),
        ({"wheelbase": -1.0}, "wheelbase"),
        ({"controller": "magic"}, "magic"),
    ],
)
def test_what_cannot_be_driven_is_not_configured(monkeypatch, parameters, text):
    ros = Ros(**parameters)
    assert ros.install(monkeypatch).on_configure(None) == FAILURE
    (line,) = ros.logged
    assert text in line


def test_the_package_has_the_layout_of_ament():
    manifest = ElementTree.parse(PACKAGE / "package.xml").getroot()
    name = manifest.findtext("name")
    assert name == PACKAGE.name
    assert manifest.findtext("export/build_type") == "ament_python"
    assert (PACKAGE / "resource" / name).read_bytes() == b""
    setup = (PACKAGE / "setup.py").read_text()
    for file in re.findall(r'\["([\w/.]+)"\]', setup):
        assert (PACKAGE / file).is_file()
    depends = {entry.text for entry in manifest.findall("exec_depend")}
    node = (PACKAGE / name / "guidance_node.py").read_text()
    imported = set(re.findall(r"^(?:from|import) (\w+)", node, re.MULTILINE))
    assert imported - {"numpy", "ttempc"} <= depends
