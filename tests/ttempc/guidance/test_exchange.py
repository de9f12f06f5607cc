"""Exchange of estimator, reference and controller for learnt model parameters."""

import time
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.ttempc.sensed_drive import SensedDrive
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.guidance.controllers import make_controller
from ttempc.guidance.guidance import Guidance
from ttempc.learning.learner import Identification, ParameterChange
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import Command
from ttempc.vehicle import CommandLimits, Vehicle

PERIOD_S = 0.2
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
def samples():
    """Samples of a drive from the first straight into the first circle."""
    return [measurements for measurements, _ in SensedDrive(seed=4).run(TICKS).received]


def driven(samples, *identifiers, controller: Any = "ttempc", estimator: Any = "ekf"):
    """Return a guidance after all samples, its commands (N, 3) and what was learnt by tick."""
    guidance = Guidance(
        VEHICLE, PATH, PERIOD_S, controller, estimator, learn=identifiers, detect=False
    )
    sent, learnt = [], {}
    for k, measurements in enumerate(samples):
        guidance.update(k * PERIOD_S, measurements)
        sent.append(guidance.step().as_array())
        if guidance.diagnostics.learnt:
            learnt[k] = guidance.diagnostics.learnt
    return guidance, np.array(sent), learnt


@pytest.mark.parametrize("name", NAMES)
def test_an_exchange_changes_nothing_before_its_tick_and_no_command_beyond_its_rate(samples, name):
    _, alone, nothing = driven(samples, controller=name)
    guidance, sent, learnt = driven(samples, Fixed(), controller=name)
    assert nothing == {}
    assert learnt == {EXCHANGE: ("vehicle.wheelbase 1.4 -> 1.47 +- 0.01 m",)}
    assert guidance.vehicle == guidance.reference.vehicle == replace(VEHICLE, wheelbase=1.47)
    np.testing.assert_array_equal(sent[:EXCHANGE], alone[:EXCHANGE])
    assert not np.array_equal(sent[EXCHANGE:], alone[EXCHANGE:])
    steps = np.abs(np.diff(sent, axis=0))
    assert (steps <= CommandLimits.of(VEHICLE, PERIOD_S).step + 1e-12).all()


@pytest.mark.parametrize("name", NAMES)
def test_an_exchange_for_the_same_vehicle_is_no_bump(samples, name):
    """What a controller remembers, such as integrals and the last command, must go on."""
    _, alone, _ = driven(samples, controller=name)
    _, sent, learnt = driven(samples, Fixed(factor=1.0 + 1e-9), controller=name)
    assert list(learnt) == [EXCHANGE]
    # The robust laws restart the prediction of one step: their action, at most 0.2, is missing at
    # one tick.
    memoryless = name in {"pid", "lqr", "feedforward", "ttempc-nominal"}
    change = np.abs(sent - alone)[EXCHANGE:]
    assert change[0].max() < (1e-5 if memoryless else 0.2)
    assert change[2:].max() < (1e-5 if memoryless else 0.03)


def test_a_run_does_not_depend_on_the_time_that_learning_takes(samples):
    _, fast, _ = driven(samples, Fixed(), controller="pid")
    _, slow, learnt = driven(samples, Fixed(takes_s=0.5), controller="pid")
    assert list(learnt) == [EXCHANGE]
    np.testing.assert_array_equal(fast, slow)


def test_any_parameter_can_be_learnt_one_after_the_other(samples):
    identifiers = Fixed("steering_lag_t", 1.5), Fixed("wheelbase", 0.9)
    guidance, _, learnt = driven(samples, *identifiers, controller="pid")
    assert guidance.vehicle == replace(
        VEHICLE, steering_lag_t=VEHICLE.steering_lag_t * 1.5, wheelbase=VEHICLE.wheelbase * 0.9
    )
    assert learnt[EXCHANGE][0] == "vehicle.steering_lag_t 0.15 -> 0.225 +- 0.01 s"


def test_a_factory_is_asked_again_and_an_object_stays(samples):
    made = []

    class Straight:
        def __init__(self, vehicle, reference, period_s):
            made.append((vehicle, reference.vehicle))

        def step(self, estimate, k):
            return Command(0.0, 0.0, 0.7)

    guidance, _, _ = driven(samples, Fixed(), controller=Straight)
    assert made == [(VEHICLE, VEHICLE), (guidance.vehicle, guidance.vehicle)]
    assert guidance.vehicle.wheelbase == VEHICLE.wheelbase * 1.05

    reference = Reference(PATH, VEHICLE, ConstantSpeed(1.0))
    own = make_controller("pid", VEHICLE, reference, PERIOD_S)
    guidance, _, learnt = driven(samples, Fixed(), controller=own)
    assert guidance.reference.vehicle == VEHICLE  # as that of the controller
    assert "controller was given as an object" in learnt[EXCHANGE][1]
    filter_ = ExtendedKalmanFilter(VEHICLE)
    _, _, learnt = driven(samples, Fixed(), controller="pid", estimator=filter_)
    assert "estimator was given as an object" in learnt[EXCHANGE][1]


@pytest.mark.parametrize(
    ("identifier", "message"),
    [
        (Fixed(error=ValueError("no data")), "nothing more: ValueError: no data"),
        (Fixed("wheelbase", 8.0), "nothing more: InvalidPath: path too tight"),
    ],
)
def test_what_cannot_be_learnt_is_told_and_the_old_parts_drive_on(samples, identifier, message):
    _, alone, _ = driven(samples, controller="pid")
    guidance, sent, learnt = driven(samples, identifier, controller="pid")
    assert learnt[EXCHANGE][0].startswith(message)
    assert guidance.vehicle == VEHICLE
    np.testing.assert_array_equal(sent, alone)


@pytest.mark.parametrize("name", ["ttempc", "pid", "paper"])
def test_learnt_dead_times_are_compensated_from_the_exchange_on(samples, name):
    class Slow(Fixed):
        def identify(self, window, vehicle):
            times = {"dead_time_t": 0.3, "dead_time_i": 0.2, "dead_time_hp": 0.4}
            changes = tuple(ParameterChange(key, 0.0, t, 0.01) for key, t in times.items())
            return Identification(replace(vehicle, **times), changes, settled=True)

    guidance, sent, learnt = driven(samples, Slow(), controller=name)
    assert len(learnt[EXCHANGE]) == 3
    assert guidance.vehicle.dead_times.tolist() == [0.3, 0.2, 0.4]
    assert np.isfinite(sent).all()
    steps = np.abs(np.diff(sent, axis=0))
    assert (steps <= CommandLimits.of(VEHICLE, PERIOD_S).step + 1e-12).all()
