"""Saturated LQ robust law and its monitor of single steps."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from tests.ttempc.tubes import DESIGN, REFERENCE, VEHICLE
from ttempc.laws.articulated_mpc import articulated_controller
from ttempc.laws.law_records import (
    GAIN_SCHEDULE,
    LAW,
    MEMORY,
    MODELLING_ERROR,
    ONE_STEP,
    TUBE_REPORT,
    law_of,
    new_memory,
)
from ttempc.laws.options import ArticulatedOptions, MpcOptions
from ttempc.laws.parts import robust_gains
from ttempc.laws.robust_action import report_tube, write_robust_action
from ttempc.layout import TICK, new_tick
from ttempc.models.kinematics import trailer_point
from ttempc.mpc.articulated_error import error_dynamics, error_state
from ttempc.mpc.lmpc import CondensedHorizon
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import report_rows
from ttempc.tube.sets import DisturbanceSet
from ttempc.types import Disturbance, Estimate, MapDisturbance, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
TICKS = 150
SIZE = len(State) + len(Disturbance) + len(MapDisturbance)


@cache
def model():
    return error_dynamics(Reference(figure_eight(), Vehicle(), ConstantSpeed(1.0)), PERIOD_S, TICKS)


class RobustPart:
    """The robust part alone, on errors that are given."""

    def __init__(self, tuning):
        a, b, c = model()
        self.horizon = CondensedHorizon(a, b, MpcOptions(), PERIOD_S, c)
        self.stages = self.horizon.stages
        self.law = law_of(
            ONE_STEP,
            np.zeros((TICKS, 7)),
            np.zeros((TICKS, 3)),
            Vehicle(),
            TICKS,
            gains=robust_gains(a, b, c, tuning.input_weight) / np.array(tuning.saturation)[:, None],
            saturation=np.array(tuning.saturation),
            forgetting=math.exp(-PERIOD_S / tuning.memory_s),
        )
        self.memory = new_memory()
        self.record = self.memory.view(MEMORY)[0]

    def step(self, k, error, previous):
        """Return action, modelling error, and the error on which the MPC acts."""
        work = self.horizon.work()
        work.state[:] = error
        work.previous[:] = previous
        tick = new_tick()
        self.record["fallback"], self.record["previous"] = 0.0, previous
        write_robust_action(k, self.law, self.stages, self.memory, work, tick)
        modelling_error = tick.view(TICK)[0]["tracking"][MODELLING_ERROR:]
        return self.record["action"].copy(), modelling_error, work.state

    def sent(self, k, mpc_state, feedback):
        record = self.record
        record["last_tick"] = k
        record["error"] = mpc_state
        record["feedback"] = feedback
        record["next_nominal"] = self.stages.a[k] @ mpc_state + self.stages.b[k] @ feedback


def test_action_stays_within_its_authority():
    tuning = ArticulatedOptions()
    generator = np.random.default_rng(52)
    law = RobustPart(tuning)
    for k in range(TICKS - 1):
        error = 10.0 ** generator.uniform(-3.0, 2.0) * generator.normal(size=SIZE)
        action, _, mpc_state = law.step(k, error, np.zeros(3))
        assert np.all(np.abs(action) <= tuning.saturation)
        law.sent(k, mpc_state, np.zeros(3))


def test_model_that_is_right_needs_no_robust_action():
    a, b, _ = model()
    generator = np.random.default_rng(53)
    law, error, feedback = (
        RobustPart(ArticulatedOptions()),
        0.1 * generator.normal(size=SIZE),
        np.zeros(3),
    )
    for k in range(30):
        action, modelling_error, mpc_state = law.step(k, error, feedback)
        np.testing.assert_allclose(action, 0.0, atol=1e-12)
        np.testing.assert_allclose(modelling_error, 0.0, atol=1e-12)
        feedback = 0.05 * generator.normal(size=3)
        law.sent(k, mpc_state, feedback)
        error = a[k] @ error + b[k] @ feedback


def test_autocorrelation_is_the_correlation_of_a_signal_with_its_past():
    """Of white noise, of an autoregressive signal, and of one that changes its sign."""
    generator = np.random.default_rng(54)
    law, signal = RobustPart(ArticulatedOptions(memory_s=20.0)), np.zeros(3)
    gains = np.zeros((TICKS, 3, 7))
    gains[:, range(3), range(3)] = 1.0
    law.law.schedule.view(GAIN_SCHEDULE)["gains"][:, 0] = gains
    law.law.constants.view(LAW)["saturation"] = 1.0
    law.sent(0, np.zeros(SIZE), np.zeros(3))  # the nominal state of tick 1 is 0
    estimates = []
    for _ in range(3000):
        signal = np.array([0.0, 0.6, -0.6]) * signal + generator.normal(size=3)
        error = np.concatenate([signal, np.zeros(SIZE - 3)])
        estimates.append(np.arctanh(law.step(1, error, np.zeros(3))[0]) / signal)
    np.testing.assert_allclose(np.mean(estimates, axis=0), [0.0, 0.6, 0.0], atol=0.06)
    assert np.min(estimates) >= 0.0
    assert np.max(estimates) <= 1.0 + 1e-9


def test_robust_action_acts_on_autocorrelated_residuals_and_not_on_white_ones():
    """Residuals of both kinds on the linear model, with the input that was sent."""
    a, _, _ = model()
    generator = np.random.default_rng(55)
    sizes = {}
    for memory in (0.0, 0.8):
        law, error, residual, actions = (
            RobustPart(ArticulatedOptions()),
            np.zeros(SIZE),
            np.zeros(SIZE),
            [],
        )
        for k in range(TICKS - 1):
            action, _, mpc_state = law.step(k, error, np.zeros(3))
            actions.append(action)
            law.sent(k, mpc_state, np.zeros(3))
            residual[:7] = memory * residual[:7]
            residual[:2] += 0.01 * math.sqrt(1.0 - memory**2) * generator.normal(size=2)
            error = a[k] @ error + residual
        sizes[memory] = np.sqrt(np.mean(np.square(actions), axis=0))
    assert np.all(sizes[0.0] < 0.4 * sizes[0.8])


OUTPUTS = error_dynamics(REFERENCE, PERIOD_S, 60)[2][:-1, :, :7]
SKEW = np.diag([0.01, 0.01, 0.004, 0.004, 0.001, 0.001, 0.01]) + 1e-4 * np.tri(7)


def on(reference_error, k):
    """Return the estimate that is off the reference by an error of the state."""
    state = REFERENCE.at(np.array([k * PERIOD_S])).state[0] - reference_error
    return Estimate(
        k * PERIOD_S,
        state,
        np.zeros((7, 7)),
        trailer_xy=trailer_point(state, VEHICLE),
        hitch_angle=0.0,
    )


def test_what_lies_in_the_set_lies_within_the_half_widths():
    generator = np.random.default_rng(72)
    disturbance = DisturbanceSet(SKEW)
    design = replace(DESIGN, disturbance=disturbance)
    options = ArticulatedOptions(tube=False)
    feedback = articulated_controller(VEHICLE, REFERENCE, PERIOD_S, options, design).feedback
    law, outputs = feedback.law, feedback.mpc.horizon.stages.outputs
    row = np.zeros(TUBE_REPORT.itemsize // 8)
    report = row.view(TUBE_REPORT)[0]
    for k, raw in enumerate(generator.uniform(-1.2, 1.2, size=(60, 7))):
        nominal, deviation = generator.normal(size=7), disturbance.axes @ raw
        report_tube(k, law, outputs, nominal, deviation, row)
        assert report["inside"] == (np.abs(raw).max() <= 1.0)
        assert report["margin"] == pytest.approx(1.0 - np.abs(raw).max())
        np.testing.assert_allclose(report["nominal"], report_rows(OUTPUTS)[k] @ nominal)
        if report["inside"]:
            rows = report_rows(OUTPUTS)[k]
            true_deviation = np.abs(rows @ deviation) + design.estimate_error.support(rows)
            assert np.all(true_deviation <= report["half_width"] + 1e-12)


def test_the_controller_reports_what_a_step_added_and_commands_the_same():
    """A jump of the estimate is the deviation of that tick; nothing jumped before."""
    options = ArticulatedOptions(tube=False)
    monitored = articulated_controller(VEHICLE, REFERENCE, PERIOD_S, options, DESIGN)
    unmonitored = articulated_controller(VEHICLE, REFERENCE, PERIOD_S, options)
    jump = np.array([0.0, 0.03, 0.0, 0.0, 0.0, 0.0, 0.0])
    margins = []
    for k in range(7):
        estimate = on(jump if k == 6 else np.zeros(7), k)
        step, plain = monitored.step(estimate, k), unmonitored.step(estimate, k)
        assert step.command == plain.command
        assert plain.diagnostics.tube is None
        margins.append(step.diagnostics.tube.margin)
    residual = error_state(estimate.state + jump, estimate, VEHICLE)[:7]
    assert min(margins[:6]) > 0.9
    step = replace(DESIGN.disturbance, window=1)
    assert margins[6] == pytest.approx(1.0 - step.fill(residual[None])[0], abs=0.05)
