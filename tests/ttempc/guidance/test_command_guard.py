"""Command guard: commands within the limits, refusal of unusable steps."""

from dataclasses import replace

import numpy as np
import pytest

from ttempc.errors import ControllerFailed
from ttempc.guidance.supervisor import CommandGuard
from ttempc.types import Command, ControlStep, Diagnostics, Estimate, SolverReport, TubeReport
from ttempc.vehicle import CommandLimits, Vehicle

VEHICLE = Vehicle()
LIMITS = CommandLimits.of(VEHICLE, 0.2)
ESTIMATE = Estimate(0.0, np.zeros(7), np.zeros((7, 7)), np.zeros(2), 0.0)
EMPTY = Diagnostics(np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(3, dtype=bool))


class Returning:
    def __init__(self, answer):
        self.answer = answer

    def step(self, estimate, k):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def guarded(answer, previous=None):
    """Return the guarded step of `answer`, where the command before was `previous`."""
    controller = Returning(previous or Command(0.0, 0.0, 0.0))
    guard = CommandGuard(controller, LIMITS)
    if previous is not None:
        assert guard.step(ESTIMATE, 3).command == previous
    controller.answer = answer
    return guard.step(ESTIMATE, 4)


def test_a_command_inside_the_limits_passes_as_it_is():
    step = ControlStep(Command(0.1, -0.1, 0.5), EMPTY)
    assert guarded(step) is step
    assert guarded(step, Command(0.1, -0.1, 0.45)) is step


def test_random_commands_come_out_inside_amplitude_and_rate_and_nearest():
    rng = np.random.default_rng(5)
    previous = Command(0.0, 0.0, 0.5)
    for desired in rng.normal(scale=2.0, size=(200, 3)):
        sent = guarded(ControlStep(Command(*desired), EMPTY), previous).command.as_array()
        low = np.maximum(VEHICLE.input_min, previous.as_array() - 0.2 * VEHICLE.input_rate)
        high = np.minimum(VEHICLE.input_max, previous.as_array() + 0.2 * VEHICLE.input_rate)
        assert np.array_equal(sent, np.clip(desired, low, high))
        previous = Command(*sent)


@pytest.mark.parametrize("junk", [float("nan"), float("inf"), -float("inf")])
def test_an_entry_that_is_not_finite_keeps_its_value_and_is_reported(junk):
    step = guarded(ControlStep(Command(junk, 0.1, junk), EMPTY), Command(0.2, 0.1, 0.6))
    assert step.command == Command(0.2, 0.1, 0.6)
    assert step.diagnostics.limited.tolist() == [True, False, True]
    expected = "the controller's delta_t not finite, hp not finite: cut"
    assert step.diagnostics.fallback == expected
    assert guarded(ControlStep(Command(junk, 0.1, junk), EMPTY)).command == Command(0.0, 0.1, 0.0)


def test_a_cut_says_which_entry_and_whether_its_range_or_its_rate():
    beyond = VEHICLE.input_max[0] + 0.01
    jump = VEHICLE.input_rate[1] * 0.2 + 0.01
    step = guarded(ControlStep(Command(beyond, jump, 0.5), EMPTY), Command(beyond - 0.02, 0.0, 0.5))
    reason = "the controller's delta_t beyond its range, delta_i beyond its rate: cut"
    assert step.diagnostics.fallback == reason


@pytest.mark.parametrize(
    ("step", "reason"),
    [
        (None, "returned NoneType at tick 4"),
        ((0.0, 0.0, 0.0), "returned tuple"),
        (ControlStep((0.0, 0.0, 0.0), EMPTY), "must hold a Command"),
        (ControlStep(Command("a", 0.0, 0.0), EMPTY), "not of numbers"),
        (ControlStep(Command(np.zeros(2), 0.0, 0.0), EMPTY), "not of numbers"),
        (ControlStep(Command(0.0, 0.0, 0.0), None), "must hold a Command and Diagnostics"),
        (ControlStep(Command(0.0, 0.0, 0.0), replace(EMPTY, robust=np.zeros(2))), "robust"),
        (ControlStep(Command(0.0, 0.0, 0.0), replace(EMPTY, feedback=[0, 0, 0])), "feedback"),
        (
            ControlStep(Command(0.0, 0.0, 0.0), replace(EMPTY, predicted_path=np.zeros((5, 2)))),
            "predicted_path",
        ),
        (
            ControlStep(Command(0.0, 0.0, 0.0), replace(EMPTY, fallback=None)),
            "fallback must be text",
        ),
        (ValueError("lost"), "raised at tick 4: ValueError: lost"),
    ],
)
def test_an_unusable_step_fails_with_a_reason(step, reason):
    with pytest.raises(ControllerFailed, match=reason):
        guarded(step)


def test_a_bare_command_is_a_step_without_diagnostics():
    step = guarded(Command(0.1, -0.1, 0.5))
    assert step.command == Command(0.1, -0.1, 0.5)
    assert np.isnan(step.diagnostics.total).all()
    assert not step.diagnostics.limited.any()


class Malicious(BaseException):
    """Derives from no `Exception`."""


@pytest.mark.parametrize("error", [SystemExit(0), Malicious("no"), GeneratorExit(), MemoryError()])
def test_whatever_a_controller_raises_is_a_failure_of_the_controller(error):
    class Raising:
        def step(self, estimate, k):
            raise error

    with pytest.raises(ControllerFailed, match=rf"at tick 4: {type(error).__name__}") as failure:
        CommandGuard(Raising(), LIMITS).step(ESTIMATE, 4)
    assert failure.value.__cause__ is error


def test_an_interrupt_is_not_the_controllers():
    class Interrupted:
        def step(self, estimate, k):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        CommandGuard(Interrupted(), LIMITS).step(ESTIMATE, 4)


TUBE = TubeReport(True, 0.5, np.zeros(9), np.zeros(9))


@pytest.mark.parametrize(
    "changes",
    [
        {"feedforward": np.array(["a", "b", "c"])},
        {"feedback": np.zeros(3, dtype=complex)},
        {"robust": np.array([None, None, None])},
        {"predicted_path": np.full((3, 4), np.nan)},
        {"predicted_path": np.zeros((10**7, 4), dtype=np.uint8)},
        {"fallback": "a\ud800"},
        {"fallback": 10**6 * "a"},
        {"tube": "none"},
        {"tube": replace(TUBE, nominal=np.zeros(3))},
        {"tube": replace(TUBE, margin="a")},
        {"solver": SolverReport("solved", True, "many", 0.0, 0.0, 0.0)},
        {"learnt": (1,)},
    ],
    ids=range(12),
)
def test_diagnostics_that_cannot_be_logged_are_refused(changes):
    with pytest.raises(ControllerFailed, match="diagnostics") as failure:
        guarded(ControlStep(Command(0.0, 0.0, 0.5), replace(EMPTY, **changes)))
    assert len(str(failure.value)) < 500


def test_diagnostics_of_the_documented_kinds_pass():
    full = replace(EMPTY, tube=TUBE, predicted_path=np.zeros((5, 4)), learnt=("drawbar",))
    step = ControlStep(Command(0.0, 0.0, 0.5), full)
    assert guarded(step) is step
