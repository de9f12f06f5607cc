"""Live view: the messages of a log, paced by the clock, without effect on the run."""

import base64
import json
import math
import socket
import struct
import sys
import time
from itertools import takewhile

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from proving_ground.testbed.errors import LiveError
from proving_ground.testbed.messages.publisher import topics_of
from proving_ground.testbed.messages.scenery import Scenery
from proving_ground.testbed.recording.channels import (
    EVENT_TOPIC,
    REFERENCE_PATH_TOPIC,
    SCENE_TOPIC,
    STATE,
    TRANSFORMS_TOPIC,
)
from proving_ground.testbed.recording.record import Event
from proving_ground.testbed.viewers.live import PROTOCOL, LiveView
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from tests.testbed.truths import moments, truth

pytest.importorskip("foxglove")
MESSAGE, TIME = 1, 2  # opcodes of server messages in Foxglove's WebSocket protocol


class Viewer:
    """Client that implements only the WebSocket protocol."""

    def __init__(self, url):
        self.socket = connect(url, subprotocols=[PROTOCOL]).__enter__()
        assert json.loads(self.socket.recv())["op"] == "serverInfo"
        advertised = json.loads(self.socket.recv())
        assert advertised["op"] == "advertise"
        self.channels = {int(each["id"]): each for each in advertised["channels"]}
        subscriptions = [{"id": number, "channelId": number} for number in self.channels]
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))

    def messages(self, count):
        """Yield topic, time [s] and decoded message of the next messages."""
        while count:
            frame = self.socket.recv(timeout=10.0)
            if isinstance(frame, bytes) and frame[0] == MESSAGE:
                number, time_ns = struct.unpack("<IQ", frame[1:13])
                channel = self.channels[number]
                yield channel["topic"], 1e-9 * time_ns, decoded(channel, frame[13:])
                count -= 1


def decoded(channel, data):
    """Return a message by the schema that the server advertised."""
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    kind = GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))
    return kind.FromString(data)


def view(**other) -> LiveView:
    return LiveView(Scenery(("tractor",)), **{"port": 0, "speed": 100.0, **other})


def publish(sink, numbers):
    for k in numbers:
        sink.row(STATE, 0.04 * k, [float(k)] * len(STATE.fields))
        moment = truth(time_s=0.04 * k, body_xyz=np.full((1, 3), float(k)))
        sink.scenes(moments(moment))


def shown(live, viewer, numbers):
    """Return what a viewer gets of moments that are published, up to an event behind them."""
    publish(live, numbers)
    live.event(Event(0.0, "info", "end"))
    until_event = takewhile(lambda message: message[0] != EVENT_TOPIC, viewer.messages(math.inf))
    return list(until_event)


def test_a_viewer_is_offered_what_a_log_holds_and_can_decode_it():
    with view() as live:
        viewer = Viewer(live.url)
        offered = {
            each["topic"]: (each["encoding"], each["schemaName"], base64.b64decode(each["schema"]))
            for each in viewer.channels.values()
        }
        assert offered == {
            topic.name: ("protobuf", topic.schema_name, topic.schema) for topic in topics_of()
        }
        live.event(Event(0.0, "warning", "first"))
        ((topic, _, message),) = viewer.messages(1)
        assert (topic, message.message) == (EVENT_TOPIC, "first")
        # The server takes in one subscription after the other
        subscribed = set()
        while not {STATE.topic, TRANSFORMS_TOPIC} <= subscribed:
            subscribed = {topic for topic, _, _ in shown(live, viewer, [0])}
        received = shown(live, viewer, range(1, 3))
        rows = [(when, message.x_t_m) for topic, when, message in received if topic == STATE.topic]
        np.testing.assert_allclose(rows, [(0.04, 1.0), (0.08, 2.0)])
        moved = [message for topic, _, message in received if topic == TRANSFORMS_TOPIC]
        assert [message.transforms[0].translation.x for message in moved] == [1.0, 2.0]
        viewer.socket.close()


def test_who_comes_later_is_told_what_was_said_once():
    with LiveView(Scenery(("tractor",), None, b"\x0a\x00"), port=0, speed=100.0) as live:
        live.path(REFERENCE_PATH_TOPIC, 0.0, np.array([[0.0, 0.0], [1.0, 0.0]]))
        publish(live, range(3))
        viewer = Viewer(live.url)
        latest = {topic: message for topic, _, message in viewer.messages(2)}
        assert latest.keys() == {SCENE_TOPIC, REFERENCE_PATH_TOPIC}
        assert len(latest[REFERENCE_PATH_TOPIC].poses) == 2
        viewer.socket.close()


def test_viewers_come_and_go_or_read_nothing_and_the_run_goes_on():
    with view(speed=1e6) as live:
        for k in range(4):
            viewer = Viewer(live.url)
            publish(live, [k])
            if k % 2:
                viewer.socket.close()
            else:
                viewer.socket.socket.close()  # no goodbye
        viewer = Viewer(live.url)
        start = time.monotonic()
        publish(live, range(4, 1500))  # more than the server keeps for one viewer
        assert time.monotonic() - start < 30.0
        viewer.socket.socket.close()


def test_what_cannot_be_opened_is_refused(monkeypatch):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        for option, words in (
            ({"port": port}, f"port {port}.*--port"),
            ({"speed": 0.0}, "speed 0"),
            ({"port": 70000}, "65535"),
        ):
            with pytest.raises(LiveError, match=words):
                view(**option)
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(LiveError, match=r"pip install -e .*\[live\]"):
        view()


def test_pages_of_other_sites_do_not_get_the_run():
    with LiveView(Scenery(), port=0) as view:
        for origin in (None, "https://app.foxglove.dev", "http://localhost:8080", "file://"):
            with connect(view.url, subprotocols=[PROTOCOL], origin=origin) as client:
                assert json.loads(client.recv())["op"] == "serverInfo"
        for origin in (
            "http://evil.example",
            "https://foxglove.dev.evil.example",
            "https://evil.example/https://app.foxglove.dev",
            "null",
        ):
            with pytest.raises(InvalidStatus, match="403"):
                connect(view.url, subprotocols=[PROTOCOL], origin=origin)
