"""Guidance: clock, order of calls, names and objects, learnt parameters."""

from __future__ import annotations

import copy
import math
import pickle
import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.ttempc.sensed_drive import SensedDrive
from ttempc.errors import (
    ControllerFailed,
    EstimatorFailed,
    GuidanceFailed,
    InvalidPath,
    InvalidReference,
    InvalidSamples,
    InvalidTime,
    InvalidTuning,
    UnknownController,
    UnknownEstimator,
)
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.guidance.controllers import make_controller
from ttempc.guidance.guidance import Guidance
from ttempc.guidance.settings import GuidanceSettings
from ttempc.learning.learner import Identification, ParameterChange
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, ControlStep, Measurement, Sensor
from ttempc.vehicle import CommandLimits, Vehicle

PERIOD_S = 0.2
VEHICLE = Vehicle()
PATH = figure_eight()
EPOCH_S = 1_763_775_600.0
GNSS = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)


@pytest.fixture(scope="module")
def samples():
    """Samples of 80 ticks of a drive along the figure eight, a list per tick."""
    return [measurements for measurements, _ in SensedDrive(seed=4).run(80).received]


def commands(guidance, samples, origin_s=0.0):
    """Return the commands (N, 3) on recorded samples."""
    sent = []
    for k, measurements in enumerate(samples):
        shifted = [replace(item, time_s=origin_s + item.time_s) for item in measurements]
        guidance.update(origin_s + k * PERIOD_S, shifted)
        sent.append(guidance.step().as_array())
    return np.array(sent)


def test_the_epoch_of_the_clock_does_not_matter(samples):
    from_zero = commands(Guidance(VEHICLE, PATH), samples)
    from_1970 = commands(Guidance(VEHICLE, PATH), samples, EPOCH_S)
    # A stamp of the Unix epoch is exact to 2.4e-7 s: 2.4e-7 m at 1 m/s, times gains of about 10.
    np.testing.assert_allclose(from_1970, from_zero, atol=1e-5)


class Driven:
    """A guidance in the closed loop of `SensedDrive`: its estimator and its controller."""

    def __init__(self, guidance, origin_s=0.0, hidden=()):
        self.guidance, self.origin_s, self.hidden = guidance, origin_s, hidden
        self.sent, self.fallbacks = [], []

    def update(self, time_s, measurements, command):
        tick = self.guidance.tick
        shifted = [
            replace(item, time_s=self.origin_s + item.time_s)
            for item in measurements
            if tick not in self.hidden or item.sensor not in GNSS
        ]
        estimate = self.guidance.update(self.origin_s + time_s, shifted)
        return replace(estimate, time_s=estimate.time_s - self.origin_s)

    def step(self, estimate, k):
        command = self.guidance.step()
        self.sent.append(command.as_array())
        self.fallbacks.append(self.guidance.diagnostics.fallback)
        return ControlStep(command)


def test_a_step_without_an_update_holds_the_command_and_then_stops():
    """A sensor callback that dies: the estimate is old, and no clock says so."""
    driven = Driven(Guidance(VEHICLE, PATH, settings=GuidanceSettings(learn=False)))
    drive = SensedDrive(seed=4, estimator=driven)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tests.ttempc.sensed_drive.make_controller", lambda *arguments: driven)
        drive.run(60)
    assert not any(driven.fallbacks)
    last = driven.sent[-1]
    for _ in range(40):
        driven.step(None, 0)
    sent = np.array(driven.sent[60:])
    np.testing.assert_array_equal(sent[:5], np.tile(last, (5, 1)))
    np.testing.assert_array_equal(sent[:, :2], np.tile(last[:2], (40, 1)))
    assert np.all(np.diff(sent[:, 2]) <= 0.0)
    assert sent[-1, 2] == 0.0
    assert all("no new estimate" in said for said in driven.fallbacks[60:])
    assert driven.guidance.diagnostics.stopping
    driven.update(60 * PERIOD_S, drive.received[-1][0], None)
    driven.step(None, 0)
    assert "no new estimate" not in driven.fallbacks[-1]


@pytest.mark.parametrize("origin_s", [0.0, EPOCH_S, -50.0])
def test_lost_gnss_slows_down_after_ten_seconds_and_stops_after_twelve(origin_s, monkeypatch):
    driven = Driven(Guidance(VEHICLE, PATH), origin_s, hidden=range(40, 115))
    monkeypatch.setattr("tests.ttempc.sensed_drive.make_controller", lambda *arguments: driven)
    SensedDrive(seed=4, estimator=driven).run(115)
    assert not any(driven.fallbacks[:91])
    assert "half speed" in driven.fallbacks[93]
    assert "not measured for more than 12 s: stopped" in driven.fallbacks[101]
    assert driven.sent[-1][2] == 0.0


@pytest.mark.parametrize("controller", ["ttempc", "paper", "pid", "lqr"])
def test_warm_up_changes_no_result(samples, controller):
    cold, warm = (Guidance(VEHICLE, PATH, controller=controller) for _ in range(2))
    warm.warm_up()
    np.testing.assert_array_equal(commands(cold, samples), commands(warm, samples))


def test_names_factories_and_objects_make_the_same_guidance(samples):
    reference = Reference(PATH, VEHICLE, ConstantSpeed(1.0))

    def factory(vehicle, reference, period_s):
        return make_controller("pid", vehicle, reference, period_s)

    controller = make_controller("pid", VEHICLE, reference, PERIOD_S)
    expected = commands(Guidance(VEHICLE, PATH, controller="pid"), samples)
    for parts in (
        {"controller": factory, "estimator": ExtendedKalmanFilter},
        {"controller": controller, "estimator": ExtendedKalmanFilter(VEHICLE)},
    ):
        guidance = Guidance(VEHICLE, reference, **parts)
        np.testing.assert_array_equal(commands(guidance, samples), expected)


def test_calls_out_of_order_are_refused(samples):
    guidance = Guidance(VEHICLE, PATH)
    with pytest.raises(GuidanceFailed, match="update"):
        guidance.step()
    with pytest.raises(GuidanceFailed, match=r"step\(\) first"):
        _ = guidance.diagnostics
    guidance.update(5.0, samples[0])
    with pytest.raises(InvalidTime, match=r"0\.2 s before"):
        guidance.update(4.8, [])
    for wrong in (math.nan, None, "5.2", 10**400):
        with pytest.raises(InvalidTime, match="finite"):
            guidance.update(wrong, [])
    for place in (
        (None, Sensor.HITCH, (0.0,)),
        (Sensor.HITCH, 5.2, (0.0,)),
        (5.2, Sensor.HITCH, 0.0),
    ):
        with pytest.raises(InvalidSamples, match="measurements"):
            guidance.update(5.2, [Measurement(*place)])
    arrays = [replace(sample, value=np.array(sample.value)) for sample in samples[1]]
    guidance.update(5.2, arrays)  # the clock and the estimate are as before the refusals
    assert np.isfinite(guidance.step().as_array()).all()


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"controller": "papier"}, UnknownController, "'papier'"),
        ({"estimator": "ukf"}, UnknownEstimator, "allowed are ekf"),
        (
            {"settings": GuidanceSettings(options={"colour": 1}), "controller": "feedforward"},
            InvalidTuning,
            "colour",
        ),
        ({"reference": figure_eight(radius_m=2.0)}, InvalidPath, "too tight"),
        ({"settings": GuidanceSettings(speed_mps=3.0)}, InvalidReference, "hydrostat"),
        (
            {"reference": Reference(PATH, replace(VEHICLE, wheelbase=2.0), ConstantSpeed(1.0))},
            InvalidReference,
            "another vehicle",
        ),
    ],
)
def test_impossible_guidance_is_refused(arguments, error, words):
    with pytest.raises(error, match=words):
        Guidance(**{"vehicle": VEHICLE, "reference": PATH, **arguments})


def test_exceptions_of_users_code_keep_their_cause(samples):
    class Broken:
        def step(self, estimate, k):
            raise KeyError("k")

        def update(self, time_s, measurements, command):
            raise ValueError("v")

    guidance = Guidance(VEHICLE, PATH, controller=Broken())
    guidance.update(0.0, samples[0])
    with pytest.raises(ControllerFailed, match="tick 0: KeyError") as caught:
        guidance.step()
    assert isinstance(caught.value.__cause__, KeyError)
    with pytest.raises(EstimatorFailed, match="ValueError: v"):
        Guidance(VEHICLE, PATH, estimator=Broken()).update(0.0, [])


VEHICLE = Vehicle()
PATH = figure_eight()
EXCHANGE = 40  # tick: an attempt at 6 s, its exchange 2 s later
TICKS = 130
NAMES = ["ttempc", "ttempc-nominal", "paper", "pid", "lqr", "feedforward", "nmpc-rti"]


class Fixed:
    """Identifies one field of the vehicle, whatever the data."""

    def __init__(self, name="wheelbase", factor=1.05, takes_s=0.0, error=None):
        self.name, self.factor, self.takes_s, self.error = name, factor, takes_s, error

    def identify(self, window, vehicle):
        assert len(window) == 31
        time.sleep(self.takes_s)
        if self.error:
            raise self.error
        before = getattr(vehicle, self.name)
        after = before * self.factor
        changes = (ParameterChange(self.name, before, after, 0.01),)
        return Identification(replace(vehicle, **{self.name: after}), changes, settled=True)


@pytest.fixture(scope="module")
def received():
    """Samples of a drive from the first straight into the first circle."""
    return [measurements for measurements, _ in SensedDrive(seed=4).run(TICKS).received]


def driven(received, *identifiers, controller: Any = "ttempc", estimator: Any = "ekf"):
    """Return a guidance after all received, its commands (N, 3) and what was learnt by tick."""
    settings = GuidanceSettings(learn=identifiers, detect=False)
    guidance = Guidance(VEHICLE, PATH, PERIOD_S, controller, estimator, settings)
    sent, learnt = [], {}
    for k, measurements in enumerate(received):
        guidance.wait()
        guidance.update(k * PERIOD_S, measurements)
        sent.append(guidance.step().as_array())
        if guidance.diagnostics.learnt:
            learnt[k] = guidance.diagnostics.learnt
    return guidance, np.array(sent), learnt


@pytest.mark.parametrize("name", NAMES)
def test_an_exchange_changes_nothing_before_its_tick_and_no_command_beyond_its_rate(received, name):
    _, alone, nothing = driven(received, controller=name)
    guidance, sent, learnt = driven(received, Fixed(), controller=name)
    assert nothing == {}
    assert learnt == {EXCHANGE: ("vehicle.wheelbase 1.4 -> 1.47 +- 0.01 m",)}
    assert guidance.vehicle == guidance.reference.vehicle == replace(VEHICLE, wheelbase=1.47)
    np.testing.assert_array_equal(sent[:EXCHANGE], alone[:EXCHANGE])
    assert not np.array_equal(sent[EXCHANGE:], alone[EXCHANGE:])
    steps = np.abs(np.diff(sent, axis=0))
    assert (steps <= CommandLimits.of(VEHICLE, PERIOD_S).step + 1e-12).all()


@pytest.mark.parametrize("name", ["ttempc", "paper", "pid", "nmpc-rti"])
def test_copies_of_a_guidance_drive_on_alike(received, name):
    forks = [Guidance(VEHICLE, PATH, controller=name)]
    for k, measurements in enumerate(received[:60]):
        if k == 35:  # an attempt of the learner is under way
            forks += [copy.deepcopy(forks[0]), pickle.loads(pickle.dumps(forks[0]))]
        records = set()
        for each in forks:
            each.wait()
            each.update(k * PERIOD_S, measurements)
            each.step()
            parts = each.estimate_record, each._monitors.record, each.tick_record
            records.add(b"".join(part.tobytes() for part in parts))
        assert len(records) == 1


@pytest.mark.parametrize("name", NAMES)
def test_a_drive_goes_back_to_a_copied_state(received, name):
    """The same samples after it give the same bits; the copy outlives both drives."""
    guidance = Guidance(VEHICLE, PATH, controller=name, settings=GuidanceSettings(learn=False))

    def drive(ticks):
        records = []
        for k in ticks:
            guidance.update(k * PERIOD_S, received[k])
            guidance.step()
            records.append(guidance.estimate_record.tobytes() + guidance.tick_record.tobytes())
        return records

    drive(range(35))
    state = guidance.state.copy()
    first = drive(range(35, 60))
    for _ in range(2):
        guidance.restore(state)
        assert guidance.tick == 35
        assert drive(range(35, 60)) == first


@pytest.mark.parametrize("name", NAMES)
def test_an_exchange_for_the_same_vehicle_is_no_bump(received, name):
    """What a controller remembers, such as integrals and the last command, must go on."""
    _, alone, _ = driven(received, controller=name)
    _, sent, learnt = driven(received, Fixed(factor=1.0 + 1e-9), controller=name)
    assert list(learnt) == [EXCHANGE]
    # The robust laws restart the prediction of one step: their action, at most 0.2, is missing at
    # one tick.
    memoryless = name in {"pid", "lqr", "feedforward", "ttempc-nominal"}
    change = np.abs(sent - alone)[EXCHANGE:]
    assert change[0].max() < (1e-5 if memoryless else 0.2)
    assert change[2:].max() < (1e-5 if memoryless else 0.03)


def test_a_factory_is_asked_again_and_an_object_stays(received):
    made = []

    class Straight:
        def __init__(self, vehicle, reference, period_s):
            made.append((vehicle, reference.vehicle))

        def step(self, estimate, k):
            return Command(0.0, 0.0, 0.7)

    guidance, _, _ = driven(received, Fixed(), controller=Straight)
    assert made == [(VEHICLE, VEHICLE), (guidance.vehicle, guidance.vehicle)]
    assert guidance.vehicle.wheelbase == VEHICLE.wheelbase * 1.05

    reference = Reference(PATH, VEHICLE, ConstantSpeed(1.0))
    own = make_controller("pid", VEHICLE, reference, PERIOD_S)
    guidance, _, learnt = driven(received, Fixed(), controller=own)
    assert guidance.reference.vehicle == VEHICLE  # as that of the controller
    assert "controller was given as an object" in learnt[EXCHANGE][1]
    filter_ = ExtendedKalmanFilter(VEHICLE)
    _, _, learnt = driven(received, Fixed(), controller="pid", estimator=filter_)
    assert "estimator was given as an object" in learnt[EXCHANGE][1]


@pytest.mark.parametrize(
    ("identifier", "message"),
    [
        (Fixed(error=ValueError("no data")), "nothing more: ValueError: no data"),
        (Fixed("wheelbase", 8.0), "nothing more: InvalidPath: path too tight"),
    ],
)
def test_what_cannot_be_learnt_is_told_and_the_old_parts_drive_on(received, identifier, message):
    _, alone, _ = driven(received, controller="pid")
    guidance, sent, learnt = driven(received, identifier, controller="pid")
    assert learnt[EXCHANGE][0].startswith(message)
    assert guidance.vehicle == VEHICLE
    np.testing.assert_array_equal(sent, alone)


def test_the_wait_for_a_first_estimate_ends_in_a_stop():
    """A short hold is the filter's start; where the vehicle is stopped there is a fault."""
    guidance = Guidance(Vehicle(), figure_eight())
    waits = []
    words = []
    for k in range(20):
        guidance.update(PERIOD_S * k, [])
        guidance.step()
        waits.append(guidance.waits_for_estimate)
        words.append(guidance.diagnostics.fallback)
    assert waits[0]
    assert not waits[-1]
    assert waits == sorted(waits, reverse=True)
    assert all("no estimate yet" in text for text in words)
    assert "stopped" in words[-1]
