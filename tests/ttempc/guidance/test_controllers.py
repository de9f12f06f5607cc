"""The named controllers in closed loop on exact kinematics, and their common promises."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.closed_loop import PERIOD_S, drive, seen_truth
from tests.ttempc.tubes import DESIGN
from ttempc.baselines.paper import PaperOptions, paper_controller
from ttempc.errors import UnknownController
from ttempc.guidance.controllers import CONTROLLERS, make_controller
from ttempc.guidance.supervisor import Supervisor
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
NOISE = np.array([0.01, 0.01, 0.006, 0.006, 0.002, 0.002, 0.02])


def make(name):
    return make_controller(name, VEHICLE, REFERENCE, PERIOD_S, DESIGN)


def supervised(name):
    return Supervisor(make(name), REFERENCE, PERIOD_S)


def paper(**options):
    return paper_controller(VEHICLE, REFERENCE, PERIOD_S, PaperOptions(**options))


def test_feedforward_alone_follows_a_perfect_vehicle():
    """To centimetres; what is left comes from holding the inputs and from the valves' rate."""
    run = drive(make("feedforward"), REFERENCE)
    assert not run.lost
    assert max(run.tractor_m.max(), run.trailer_m.max()) < 0.05


def test_paper_holds_the_vehicle_to_decimetres():
    run = drive(make("paper"), REFERENCE, NOISE)
    assert not run.lost
    assert max(run.tractor_m.max(), run.trailer_m.max()) < 1.0
    assert not any(step.diagnostics.fallback for step in run.steps)


def test_printed_sign_loses_the_vehicle():
    assert drive(make("paper-printed-sign"), REFERENCE).lost


def test_sign_decides_in_the_tube_reading_only():
    """The one-step modelling error does not remember where the vehicle is (errata 6 and 8)."""
    assert not drive(paper(nominal="tube", robust_sign=-1), REFERENCE, NOISE).lost
    assert drive(paper(nominal="tube", robust_sign=1), REFERENCE, NOISE).lost
    assert not drive(paper(nominal="one-step", robust_sign=1), REFERENCE, NOISE).lost


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


@pytest.mark.parametrize("name", CONTROLLERS)
def test_estimate_that_is_not_finite_holds_the_command_and_says_so(name):
    supervisor = supervised(name)
    good = seen_truth(REFERENCE.at(0.0).state, 0.0, VEHICLE)
    before = supervisor.step(good, 0, 0.0).command
    blind = replace(good, state=np.full(7, np.nan))
    step = supervisor.step(blind, 1, PERIOD_S)
    assert step.command == before
    assert "not finite" in step.diagnostics.fallback
    assert supervisor.step(good, 2, 2 * PERIOD_S).diagnostics.fallback == ""


@pytest.mark.parametrize("name", CONTROLLERS)
def test_diagnostics_add_up_to_the_command(name):
    run = drive(make(name), REFERENCE, NOISE, ticks=300)
    for step in run.steps:
        free = ~step.diagnostics.limited
        total = step.diagnostics.total
        np.testing.assert_array_equal(step.command.as_array()[free], total[free])


def test_diagnostics_of_the_paper_are_complete():
    supervisor = supervised("paper")
    sample = REFERENCE.at(30.0)
    state = sample.state.copy()
    state[State.Y] += 0.1
    found = supervisor.step(seen_truth(state, 30.0, VEHICLE), 150, 30.0).diagnostics
    assert found.tracking_error is not None
    assert found.modelling_error is not None
    assert found.solver is not None
    assert found.predicted_path is not None
    assert found.tracking_error.shape == (7,)
    assert found.modelling_error.shape == (4,)
    assert found.predicted_path.shape == (8, 4)
    assert found.solver.accepted
    first = found.predicted_path[0]
    ahead = REFERENCE.at(30.2)
    np.testing.assert_allclose(first, [*ahead.state[:2], *ahead.trailer_xy], atol=0.15)
    assert first[1] - ahead.state[State.Y] == pytest.approx(0.1, abs=0.02)


def test_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(UnknownController, match=r"'papier'.*feedforward, .*paper, paper-printed"):
        make("papier")
