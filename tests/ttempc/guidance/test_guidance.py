"""Guidance: clock, order of calls, names and objects, warm-up, refusals."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.sensed_drive import SensedDrive
from ttempc.errors import (
    ControllerFailed,
    EstimatorFailed,
    GuidanceFailed,
    InvalidPath,
    InvalidReference,
    InvalidTime,
    InvalidTuning,
    UnknownController,
    UnknownEstimator,
)
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.guidance.controllers import make_controller
from ttempc.guidance.guidance import Guidance
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command, ControlStep, Sensor
from ttempc.vehicle import Vehicle

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


@pytest.mark.parametrize("origin_s", [0.0, EPOCH_S, -50.0])
def test_lost_gnss_slows_down_after_ten_seconds_and_stops_after_twelve(origin_s, monkeypatch):
    driven = Driven(Guidance(VEHICLE, PATH), origin_s, hidden=range(40, 115))
    monkeypatch.setattr("tests.ttempc.sensed_drive.make_controller", lambda *arguments: driven)
    SensedDrive(seed=4, estimator=driven).run(115)
    assert not any(driven.fallbacks[:91])
    assert "half speed" in driven.fallbacks[93]
    assert "not measured for more than 12 s: stopped" in driven.fallbacks[101]
    assert driven.sent[-1][2] == 0.0


def test_time_stamps_of_estimates_are_those_of_the_clock(samples):
    guidance = Guidance(VEHICLE, PATH)
    shifted = [replace(item, time_s=EPOCH_S + item.time_s) for item in samples[0]]
    assert guidance.update(EPOCH_S, shifted).time_s == EPOCH_S
    assert guidance.update(EPOCH_S + 0.2, []).time_s == pytest.approx(EPOCH_S + 0.2, abs=1e-6)


def test_the_tracking_error_is_computed_for_any_controller(samples):
    class Steady:
        def step(self, estimate, k):
            return Command(0.0, 0.0, 0.5)

    guidance = Guidance(VEHICLE, PATH, controller=Steady())
    estimate = guidance.update(0.0, samples[0])
    guidance.step()
    error = guidance.diagnostics.tracking_error
    start = guidance.reference.at(0.0).state
    assert np.hypot(*error[:2]) == pytest.approx(np.hypot(*(start - estimate.state)[:2]))


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


def test_ticks_are_counted_to_the_end_of_the_reference(samples):
    guidance = Guidance(VEHICLE, straight(3.0), speed_mps=1.0, detect=False)
    count = 0
    while not guidance.finished:
        guidance.update(count * PERIOD_S, samples[count])
        guidance.step()
        count += 1
    assert count == guidance.tick == 15


@pytest.mark.parametrize("controller", ["ttempc", "pid", "nmpc-rti"])
def test_a_guidance_is_freed_without_the_garbage_collector(samples, controller):
    """A worker drives thousands of runs: one that waits for the collector keeps their memory."""
    gc.collect()
    gc.disable()
    try:
        guidance = Guidance(VEHICLE, PATH, controller=controller)
        commands(guidance, samples[:20])
        alive = weakref.ref(guidance)
        del guidance
        assert alive() is None
    finally:
        gc.enable()


def test_calls_out_of_order_are_refused(samples):
    guidance = Guidance(VEHICLE, PATH)
    with pytest.raises(GuidanceFailed, match="update"):
        guidance.step()
    with pytest.raises(GuidanceFailed, match=r"step\(\) first"):
        _ = guidance.diagnostics
    guidance.update(5.0, samples[0])
    with pytest.raises(InvalidTime, match=r"0\.2 s before"):
        guidance.update(4.8, [])
    with pytest.raises(InvalidTime, match="finite"):
        guidance.update(float("nan"), [])


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"controller": "papier"}, UnknownController, "'papier'"),
        ({"estimator": "ukf"}, UnknownEstimator, "allowed are ekf, nmhe"),
        ({"options": {"colour": 1}, "controller": "feedforward"}, InvalidTuning, "colour"),
        ({"reference": figure_eight(radius_m=2.0)}, InvalidPath, "too tight"),
        ({"speed_mps": 3.0}, InvalidReference, "hydrostat"),
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
