"""The named controllers in closed loop on exact kinematics, and their common promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, Supervised, drive, seen_truth
from tests.ttempc.tubes import DESIGN
from ttempc.baselines.paper import PaperOptions, paper_controller
from ttempc.guidance.controllers import CONTROLLERS, make_controller
from ttempc.layout import TICK, estimate_row, new_tick
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
NOISE = np.array([0.01, 0.01, 0.006, 0.006, 0.002, 0.002, 0.02])


def make(name):
    return make_controller(name, VEHICLE, REFERENCE, PERIOD_S, DESIGN)


def supervised(name):
    return Supervised(make(name), REFERENCE, PERIOD_S)


def paper(**options):
    return paper_controller(VEHICLE, REFERENCE, PERIOD_S, PaperOptions(**options))


def test_printed_sign_loses_the_vehicle():
    assert drive(make("paper-printed-sign"), REFERENCE).lost


def test_sign_decides_unless_the_nominal_state_is_a_one_step_prediction():
    """The one-step modelling error does not remember where the vehicle is (errata 6 and 8)."""
    tube = {"nominal": "model", "mpc_start": "nominal"}
    assert not drive(paper(**tube), REFERENCE, NOISE).lost
    assert drive(paper(**tube, robust_sign=1), REFERENCE, NOISE).lost
    one_step = {"nominal": "one-step", "hp_in_cost": "fraction", "hitch_angle": "subtracted"}
    assert not drive(paper(**one_step, robust_sign=1), REFERENCE, NOISE).lost


@pytest.mark.parametrize("name", CONTROLLERS)
def test_commands_stay_within_the_vehicle_whatever_the_estimate(name):
    generator = np.random.default_rng(51)
    supervisor = supervised(name)
    previous = None
    for k in range(300):
        state = REFERENCE.at(k * PERIOD_S).state
        state = state + 10.0 ** generator.uniform(-3, 3) * generator.normal(size=7)
        if generator.uniform() < 0.2:
            state[generator.integers(7)] = generator.choice([np.nan, np.inf, -np.inf])
            estimate = replace(seen_truth(np.nan_to_num(state), 0.0, VEHICLE), state=state)
        else:
            estimate = seen_truth(state, 0.0, VEHICLE)
        step = supervisor.step(estimate, k, 0.0)
        command = step.command.as_array()
        assert np.all(np.isfinite(command))
        assert np.all((VEHICLE.input_min <= command) & (command <= VEHICLE.input_max))
        assert np.all(np.isfinite(step.diagnostics.total))
        if previous is not None:
            assert np.all(np.abs(command - previous) <= VEHICLE.input_rate * PERIOD_S + 1e-12)
        previous = command


@pytest.mark.parametrize("name", ["ttempc", "ttempc-nominal", "nmpc-rti"])
def test_a_held_back_vehicle_is_steered_the_same_however_slow_it_is(name):
    """In a curve, on the path; free to keep up, a vehicle that stands is steered far aside."""
    k, sent = 150, []
    state, planned = REFERENCE.at(k * PERIOD_S).state, make(name)._feedforward[k - 1]
    for waits, share in ((1.0, 0.0), (1.0, 0.5), (0.0, 0.0)):
        estimate, tick = seen_truth(state * [1, 1, 1, 1, 1, 1, share], 0.0, VEHICLE), new_tick()
        row, tick.view(TICK)[0]["waits"] = estimate_row(estimate), waits
        make(name).act(row, lambda e=estimate: e, k, planned * [1, 1, share], tick)
        sent.append(tick.view(TICK)[0]["control"][:2, :3].sum(axis=1) - planned[:2])
    np.testing.assert_array_equal(sent[0], sent[1])
    assert np.abs(sent[0]).max() < 0.5 * np.abs(sent[2]).max()


@pytest.mark.parametrize("name", CONTROLLERS)
def test_diagnostics_add_up_to_the_command(name):
    run = drive(make(name), REFERENCE, NOISE, ticks=300)
    for step in run.steps:
        free = ~step.diagnostics.limited
        total = step.diagnostics.total
        np.testing.assert_array_equal(step.command.as_array()[free], total[free])
