"""Sessions with peers over the local host: pace, lock-step, lost and late commands, strangers."""

import contextlib
import json
import math
import re
import socket
import struct
import threading
import time
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from proving_ground.experiments.errors import ServeError
from proving_ground.experiments.interfaces.serve import session as session_module
from proving_ground.experiments.interfaces.serve.agopengps import AgOpenGpsProtocol, Dialect
from proving_ground.experiments.interfaces.serve.json_protocol import JsonProtocol
from proving_ground.experiments.interfaces.serve.link import Link, Trouble
from proving_ground.experiments.interfaces.serve.session import (
    RemoteController,
    Session,
    SessionSettings,
)
from proving_ground.experiments.run.simulate import drive_into
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.geodesy import MapFrame
from proving_ground.testbed.recording.channels import CONTROL, STATE
from proving_ground.testbed.recording.record import Recorder

from tests.experiments.interfaces.serve.test_agopengps import (
    read_paogi,
    steering_frame,
    web_frame,
)

LOCAL = ("127.0.0.1", 0)
HELLO = b'{"type":"hello","version":1,"name":"test","reference":1,"estimate":true}'
FLAT = ["terrain.iso_class=flat", "controller.learn=false"]
STANDS = 3  # positions before the autosteer button is on
PATIENCE_S = 30.0  # of tests, so that none hangs


class Peer(threading.Thread):
    """Peer that answers each datagram with what `answer(datagram)` returns.

    Where nothing comes for 0.2 s, it sends its last datagrams again.
    """

    def __init__(self, address, first, answer):
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(LOCAL)
        self.socket.settimeout(0.2)
        self.address, self.first, self.answer = address, first, answer
        self.stopping = threading.Event()
        self.start()

    def run(self):
        last = payloads = list(self.first)
        begun = time.monotonic()
        while not self.stopping.is_set() and time.monotonic() < begun + PATIENCE_S:
            for payload in payloads:
                self.socket.sendto(payload, self.address)
            try:
                payloads = self.answer(self.socket.recv(65535))
                last = payloads or last
            except TimeoutError:
                payloads = last

    def close(self):
        self.stopping.set()
        self.join()
        self.socket.close()


def follow(datagram, **changes):
    """Return the inputs of the reference, corrected by the errors of heading and position."""
    message = json.loads(datagram)
    if message["type"] != "samples":
        return []
    at, to = message["estimate"], message["reference"][0]
    left = (at["y_m"] - to["y_m"]) * math.cos(to["yaw_rad"])
    left -= (at["x_m"] - to["x_m"]) * math.sin(to["yaw_rad"])
    steering = to["delta_t_rad"] - 0.8 * left - (at["yaw_rad"] - to["yaw_rad"])
    command = {"type": "command", "tick": message["tick"], "delta_t_rad": steering}
    return [json.dumps(command | {"delta_i_rad": 0.0} | changes).encode()]


def drive(
    answer,
    protocol=None,
    *,
    length_m=6.0,
    first=(HELLO,),
    settings=None,
    beside=None,
    rates=(),
):
    """Return record, outcome, counts and session of a straight drive with a peer."""
    path = f"path={{kind='straight', length_m={length_m}}}"
    _, scenario = load("pavement", [*rates, path, *FLAT])
    scenario = replace(scenario, controller=replace(scenario.controller, options={}))
    settings = settings or SessionSettings(lockstep=True, wait_s=PATIENCE_S)
    with Link(LOCAL) as link, contextlib.ExitStack() as stack:
        peer = Peer(link.address, first, answer)
        stack.callback(peer.close)
        if beside:
            stack.enter_context(beside(link.address))
        session = Session("grass", link, protocol or JsonProtocol(), settings, lambda line: None)
        factory = partial(RemoteController, link=session.commands)
        assembly = session.assemble(scenario, 1, factory)
        recorder = Recorder()
        outcome = drive_into(recorder, assembly)
        session.end(outcome.status)
        return recorder.record(), outcome, link.counts, session


def test_in_lockstep_the_same_commands_give_the_same_bits_whatever_the_network_does():
    def disturbed(datagram, seen=[]):  # noqa: B006 - a memory
        seen.append(datagram)
        answers = follow(datagram)
        if len(seen) % 7 == 0:
            return []  # this command is lost
        if len(seen) % 5 == 0:
            time.sleep(0.15)  # late
            return answers * 2  # twice
        return answers

    plain, outcome, counts, session = drive(follow)
    other, second, troubles, _ = drive(disturbed)
    assert outcome.status == second.status == "completed"
    assert session.used == 30  # 6 m at 1 m/s, 0.2 s each
    assert set(counts) <= {Trouble.REPEATED}  # of a peer that is kept waiting
    assert troubles[Trouble.REPEATED] > 0
    for channel in (STATE, CONTROL):
        np.testing.assert_array_equal(
            plain.tables[channel.topic].values, other.tables[channel.topic].values
        )


def test_samples_lost_in_lockstep_come_again_when_the_peer_repeats_itself():
    def deaf(datagram, lost=[]):  # noqa: B006 - a memory
        message = json.loads(datagram)
        if message.get("tick") == 7 and not lost:
            lost.append(datagram)
            time.sleep(0.2)
            return [json.dumps({"type": "command", "tick": 6, "delta_t_rad": 1.0}).encode()]
        return follow(datagram)

    _, outcome, counts, session = drive(deaf)
    assert outcome.status == "completed"
    assert session.used == 30
    assert set(counts) == {Trouble.REPEATED}


def test_the_clock_is_kept_without_drift_at_a_factor():
    period_s = 0.2 / 5.0
    settings = SessionSettings(speed=5.0, wait_s=PATIENCE_S)
    _, outcome, counts, _ = drive(follow, length_m=10.0, settings=settings)
    assert outcome.status == "completed"
    assert outcome.wall_s > 49 * period_s  # the last of 50 ticks begins no earlier
    if not counts[Trouble.OVERRUN]:  # on a machine that is not loaded
        assert outcome.wall_s < 50 * period_s + 0.08


def silent_from(first, last):
    """Return a peer that sends nothing from one tick to another."""

    def answer(datagram):
        tick = json.loads(datagram).get("tick", 0)
        return [] if first <= tick < last else follow(datagram)

    return answer


def test_a_silent_peer_stops_the_vehicle_and_the_reference_waits_for_it_to_return():
    settings = SessionSettings(speed=4.0, wait_s=PATIENCE_S, hold_s=2.0)
    record, outcome, counts, _ = drive(silent_from(10, 66), length_m=8.0, settings=settings)
    assert outcome.status == "completed"
    assert counts[Trouble.MISSING] >= 50
    control, state = record.tables[CONTROL.topic], record.tables[STATE.topic]
    held = (control.time_s > 2.3) & (control.time_s < 3.9)
    assert np.ptp(control["delta_t_rad_command"][held]) == 0.0  # held for two seconds
    speed = np.interp([3.9, 12.5], state.time_s, state["v_mps"])
    assert speed[0] > 0.8
    assert abs(speed[1]) < 0.05
    assert state["v_mps"][-1] > 0.5  # it has driven on
    texts = [event.text for event in record.events]
    assert any("no command over UDP for more than 2 s: stopped" in text for text in texts)
    assert re.match(r"UDP: .* \d+ periods without a command in time", texts[-1])


def test_commands_that_are_one_tick_late_drive_all_the_same():
    def late(datagram, kept=[]):  # noqa: B006 - a memory
        kept.append(follow(datagram))
        return kept[-2] if len(kept) > 2 else []

    settings = SessionSettings(speed=8.0, wait_s=PATIENCE_S)
    record, outcome, counts, session = drive(late, settings=settings)
    assert outcome.status == "completed"
    assert session.used == 0
    assert counts[Trouble.LATE] >= 25
    assert abs(record.tables[STATE.topic]["y_t_m"]).max() < 0.3


@contextlib.contextmanager
def stranger(address):
    """Send commands to turn from another address, ever again."""
    stop = threading.Event()
    other = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)

    def shout():
        for tick in range(100_000):
            if stop.wait(0.002):
                return
            command = {"type": "command", "tick": tick // 10, "delta_t_rad": 0.6}
            other.sendto(json.dumps(command).encode(), address)

    thread = threading.Thread(target=shout, daemon=True)
    thread.start()
    yield
    stop.set()
    thread.join()
    other.close()


def test_strangers_and_nonsense_are_counted_and_change_no_bit():
    def noisy(datagram):
        return [b"nonsense", b"x" * 5000, *follow(datagram)]

    plain, *_ = drive(follow)
    record, outcome, counts, _ = drive(noisy, beside=stranger)
    assert outcome.status == "completed"
    assert counts[Trouble.STRANGER] > 0
    assert counts[Trouble.INVALID] >= 60
    table = record.tables[STATE.topic]
    np.testing.assert_array_equal(table.values, plain.tables[STATE.topic].values)


def test_without_a_peer_nothing_starts_and_one_that_leaves_ends_a_run_in_lockstep():
    settings = SessionSettings(lockstep=True, wait_s=0.5)
    _, outcome, _, _ = drive(silent_from(10, 1000), settings=settings)
    assert outcome.status == "invalid"
    assert "tick 10" in outcome.failure
    with pytest.raises(ServeError, match=r"0\.5 s"):
        drive(lambda datagram: [], first=(b"{}",), settings=settings)


class AgOpenGps:
    """Stand-in of AgOpenGPS: steers onto a line to the left, from position frames alone."""

    def __init__(self, offset_m):
        self.offset_m, self.start, self.positions = offset_m, None, []

    def __call__(self, datagram):
        if datagram[3] != 214:
            return []
        longitude, latitude, heading = struct.unpack_from("<ddf", datagram, 5)
        east, north = MapFrame().points(latitude, longitude)
        if self.start is None:
            self.start = east, north, math.radians(heading)
        x, y, course = self.start
        right = (east - x) * math.cos(course) - (north - y) * math.sin(course)
        self.positions.append(right)
        turned = (heading - math.degrees(course) + 180.0) % 360.0 - 180.0
        angle = -1.2 * turned - 25.0 * (right + self.offset_m)
        limited = max(-30.0, min(30.0, angle))
        engaged = len(self.positions) > STANDS
        return [steering_frame(limited, engaged)]


def test_who_does_not_steer_does_not_own_the_session():
    @contextlib.contextmanager
    def squatter(address):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(off, address)
            yield

    off, protocol = steering_frame(0.0, False), AgOpenGpsProtocol(Dialect.AGOPENGPS)
    _, outcome, *_ = drive(AgOpenGps(0.1), protocol, first=(off,), beside=squatter)
    assert outcome.status == "completed"


def test_agopengps_steers_onto_a_line_of_its_own_beside_the_path():
    offset_m = 0.8
    guidance = AgOpenGps(offset_m)
    off = steering_frame(0.0, False)
    protocol = AgOpenGpsProtocol(Dialect.AGOPENGPS)
    record, outcome, counts, _ = drive(guidance, protocol, length_m=16.0, first=(off,))
    assert outcome.status == "completed"
    assert set(counts) <= {Trouble.REPEATED}  # of a peer that is kept waiting
    state = record.tables[STATE.topic]
    assert state["y_t_m"][-25:].mean() == pytest.approx(offset_m, abs=0.1)  # to the left is +y
    assert state["v_mps"][-25:].mean() == pytest.approx(1.0, abs=0.05)  # held by the plant
    waited = guidance.positions[: STANDS + 1]  # at the start, until the button was on
    assert waited == pytest.approx([0.0] * len(waited), abs=1e-9)
    assert guidance.positions[STANDS + 1] != 0.0  # measured, with noise


class AgOpenWeb:
    """Stand-in of AgOpenWeb: engages, disengages for some time, and engages again.

    It answers every status of the module with PGN 254, and steers along its course by the
    positions of `$PAOGI` alone. `status(k)` is that of its k-th answer.
    """

    def __init__(self, status):
        self.status, self.answers, self.sentences = status, 0, []

    def __call__(self, datagram):
        if datagram[:1] == b"$":
            self.sentences.append(read_paogi(datagram))
            return []
        if datagram[3] != 253:
            return []
        self.answers += 1
        return [web_frame(self.status(self.answers), 0.0)]


def disengaged_between(first, last):
    """Return the status of answers: idle at first, then engaged, not from `first` to `last`."""

    def status(answer):
        if answer < STANDS:
            return 0x09  # its switch is on and its GNSS valid
        return 0x19 if first <= answer < last else 0x1D

    return status


def test_the_vehicle_stops_within_a_fifth_of_a_second_of_disengaging_and_drives_on_after_it():
    """At 20 Hz on the clock; answers 40 to 140 after the start are not engaged."""
    guidance = AgOpenWeb(disengaged_between(40, 140))
    settings = SessionSettings(speed=1.0, wait_s=PATIENCE_S)
    record, outcome, _, session = drive(
        guidance,
        AgOpenGpsProtocol(),
        length_m=8.0,
        first=(web_frame(0x00),),
        settings=settings,
        rates=AgOpenGpsProtocol.defaults,
    )
    assert outcome.status == "completed"
    assert session._protocol.peer_name == "AgOpenWeb"
    assert guidance.sentences
    (stop_s,) = [one.time_s for one in record.events if "disengaged over UDP: stop" in one.text]
    released_s = 0.05 * (40 - STANDS)  # an answer a tick
    assert released_s - 0.2 <= stop_s <= released_s + 0.2
    state = record.tables[STATE.topic]
    assert np.abs(state["v_mps"]).min() < 0.05  # it stood
    assert state["v_mps"][-1] > 0.5  # it has driven on


def test_the_vehicle_stops_within_a_fifth_of_a_second_of_silence():
    def status(answer):
        return 0x09 if answer < STANDS else 0x1D

    class Silent(AgOpenWeb):
        def __call__(self, datagram):
            answer = super().__call__(datagram)
            return [] if 40 <= self.answers < 100 else answer

    guidance = Silent(status)
    settings = SessionSettings(speed=1.0, wait_s=PATIENCE_S)
    record, outcome, *_ = drive(
        guidance,
        AgOpenGpsProtocol(),
        length_m=4.0,
        first=(web_frame(0x00),),
        settings=settings,
        rates=AgOpenGpsProtocol.defaults,
    )
    assert outcome.status == "completed"
    (stop_s, *_) = [one.time_s for one in record.events if "no command over UDP" in one.text]
    silent_s = 0.05 * (40 - STANDS)
    assert silent_s - 0.2 <= stop_s <= silent_s + 0.2


def one_frame(payload):
    """Return what sends one datagram beside the peer and is silent from then on."""

    @contextlib.contextmanager
    def squatter(address):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(payload, address)
            yield

    return squatter


def test_one_frame_and_silence_do_not_keep_the_session_from_the_one_who_drives(monkeypatch):
    monkeypatch.setattr(session_module, "_OWNED_S", 0.3)
    guidance = AgOpenWeb(lambda answer: 0x09 if answer < STANDS else 0x1D)
    record, outcome, counts, session = drive(
        guidance,
        AgOpenGpsProtocol(),
        first=(web_frame(0x00),),
        length_m=3.0,
        beside=one_frame(web_frame(0x1D)),
        settings=SessionSettings(speed=2.0, wait_s=PATIENCE_S),
        rates=AgOpenGpsProtocol.defaults,
    )
    assert outcome.status == "completed"
    assert session.used > 30  # of 3 s at 20 Hz
    assert counts[Trouble.STRANGER] > 0  # the one who drives, before
    assert any("another one may drive" in event.text for event in record.events)


def test_a_session_without_a_command_in_time_is_not_complete():
    _, outcome, _, session = drive(
        lambda datagram: [],
        AgOpenGpsProtocol(),
        length_m=1.0,
        first=(web_frame(0x00),),
        beside=one_frame(web_frame(0x1D)),
        settings=SessionSettings(speed=4.0, wait_s=PATIENCE_S),
        rates=AgOpenGpsProtocol.defaults,
    )
    assert session.used == 0
    assert outcome.status != "completed"
    assert "no command" in outcome.failure
