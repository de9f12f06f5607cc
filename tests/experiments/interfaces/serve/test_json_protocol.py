"""Datagrams of the JSON protocol: what is refused, and what keeps its digits."""

import json

import numpy as np
import pytest
from proving_ground.experiments.interfaces.serve.json_protocol import JsonProtocol
from proving_ground.experiments.interfaces.serve.link import Refused, RunFacts, TickData

from ttempc import Vehicle, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Estimate, Measurement, Sensor

REFERENCE = Reference(straight(20.0), Vehicle(), ConstantSpeed(1.0))
FACTS = RunFacts("grass", 1, 0.2, 100, step=True, vehicle=Vehicle(), origin_deg=(44.97, -93.26))
HELLO = {"type": "hello", "version": 1, "name": "test"}
COMMAND = {"type": "command", "tick": 3, "delta_t_rad": 0.1}


def greeted(**asked):
    protocol = JsonProtocol()
    protocol.begin(FACTS, REFERENCE)
    (welcome,) = protocol.receive(json.dumps(HELLO | asked).encode()).replies
    return protocol, json.loads(welcome)


def test_the_welcome_has_what_a_controller_needs_of_the_vehicle():
    protocol, welcome = greeted()
    assert protocol.ready
    assert (welcome["period_s"], welcome["ticks"], welcome["step"]) == (0.2, 100, True)
    assert Vehicle(**welcome["vehicle"]) == Vehicle()


def test_an_operator_may_resume_once_the_peer_has_said_hello():
    protocol, _ = greeted()
    assert protocol.receive(b'{"type":"resume"}', known=True).resume
    assert not protocol.receive(json.dumps(COMMAND).encode(), known=True).resume


def test_a_command_leaves_out_what_the_plant_does_itself():
    protocol, _ = greeted()
    command = protocol.receive(json.dumps(COMMAND).encode(), known=True).command
    assert (command.tick, command.delta_t, command.delta_i, command.hp) == (3, 0.1, None, None)
    content = json.dumps(COMMAND | {"delta_i_rad": -1, "hp": 0.5}).encode()
    whole = protocol.receive(content, known=True).command
    assert (whole.delta_i, whole.hp) == (-1.0, 0.5)


def test_numbers_keep_all_their_digits_and_what_is_not_finite_is_null():
    protocol, _ = greeted(estimate=True, reference=3)
    state = np.random.default_rng(1).normal(size=7) / 3.0
    estimate = Estimate(0.6, state, np.eye(7), np.array([np.nan, 1 / 3]), 0.1)
    sample = Measurement(0.1 + 0.2, Sensor.GNSS_TRACTOR, (1 / 3, np.inf))
    (payload,) = protocol.period(TickData(3, 0.6, [sample], estimate, REFERENCE, 2))
    message = json.loads(payload)
    assert message["tick"] == 3
    assert message["samples"] == [
        {"sensor": "gnss_tractor", "time_s": 0.1 + 0.2, "value": [1 / 3, None]}
    ]
    assert list(message["estimate"].values())[:7] == state.tolist()
    assert (message["estimate"]["trailer_x_m"], message["estimate"]["trailer_y_m"]) == (None, 1 / 3)
    expected = REFERENCE.at(0.2 * np.array([2.0, 3.0, 4.0]))
    assert [stage["x_m"] for stage in message["reference"]] == expected.state[:, 0].tolist()
    assert [stage["hp"] for stage in message["reference"]] == expected.inputs[:, 2].tolist()


def test_invalid_datagrams_are_refused_with_their_reason():
    protocol, _ = greeted()
    silent = JsonProtocol()
    silent.begin(FACTS, REFERENCE)
    with pytest.raises(Refused, match="before a hello"):
        silent.receive(json.dumps(COMMAND).encode())
    for payload, text in (
        (b" " * 1025, "1025 bytes"),
        (b"", "JSON"),
        (b"\xff\xfe", "JSON"),
        (b"[" * 1000, "JSON"),
        (b"3", "object"),
        (b'{"type": "bye"}', "'hello', 'command'"),
        (COMMAND | {"speed": 1}, "`speed`"),
        (COMMAND | {"tick": -1}, "`tick`"),
        (COMMAND | {"tick": True}, "`tick`"),
        (b'{"type":"command","tick":3}', "delta_t_rad"),
        (b'{"type":"command","tick":3,"delta_t_rad":NaN}', "finite"),
        (b'{"type":"command","tick":3,"delta_t_rad":1e999}', "finite"),
        (COMMAND | {"hp": "1"}, "`hp`"),
        (HELLO | {"version": 2}, "`version`"),
        (HELLO | {"reference": 101}, "`reference`"),
        (HELLO | {"name": "n" * 61}, "`name`"),
    ):
        with pytest.raises(Refused, match=text):
            protocol.receive(
                payload if isinstance(payload, bytes) else json.dumps(payload).encode(),
                known=True,
            )
