"""Norm-optimal iterative learning on a linear plant whose optimum is known."""

import numpy as np
import pytest
from proving_ground.experiments.studies.oracle.learning import LinearLoop, learning_step

TICKS = 30
STATES = 3
INPUTS = 1
OUTPUTS = 2  # more than inputs: no error can be zero everywhere
WEIGHT = np.ones((TICKS + 1, OUTPUTS))
EFFORT = np.array([1e-3])


@pytest.fixture(scope="module")
def loop():
    """A random stable plant that changes with time."""
    rng = np.random.default_rng(5)
    return LinearLoop(
        a=0.5 * rng.normal(size=(TICKS, STATES, STATES)),
        b=rng.normal(size=(TICKS, STATES, INPUTS)),
        c=rng.normal(size=(TICKS + 1, OUTPUTS, STATES)),
        gain=0.05 * rng.normal(size=(TICKS, INPUTS, STATES)),
    )


def drive(loop, inputs, disturbance):
    """Return the outputs (N + 1, p) of a drive from rest under inputs and a disturbance."""
    z = np.zeros(STATES)
    outputs = [loop.c[0] @ z]
    for k in range(TICKS):
        z = loop.closed(k) @ z + loop.b[k] @ inputs[k] + disturbance[k]
        outputs.append(loop.c[k + 1] @ z)
    return np.array(outputs)


def response(loop):
    """Return the matrix from all inputs to all outputs, by one drive for each input."""
    still = np.zeros((TICKS, STATES))
    columns = []
    for index in range(TICKS * INPUTS):
        inputs = np.zeros(TICKS * INPUTS)
        inputs[index] = 1.0
        columns.append(drive(loop, inputs.reshape(TICKS, INPUTS), still).ravel())
    return np.array(columns).T


def test_a_step_is_the_least_squares_solution(loop):
    errors = np.random.default_rng(6).normal(size=(TICKS + 1, OUTPUTS))
    weight = np.random.default_rng(7).uniform(0.0, 2.0, size=errors.shape)
    root = np.sqrt(weight.ravel())
    effort = np.sqrt(np.tile(EFFORT, TICKS))
    matrix = np.vstack([root[:, None] * response(loop), np.diag(effort)])
    target = np.concatenate([-root * errors.ravel(), np.zeros(TICKS * INPUTS)])
    expected = np.linalg.lstsq(matrix, target, rcond=None)[0]
    found = learning_step(loop, errors, weight, EFFORT)
    np.testing.assert_allclose(found.ravel(), expected, atol=1e-9)


def test_the_error_falls_with_every_drive_to_the_least_that_inputs_permit(loop):
    disturbance = np.random.default_rng(8).normal(size=(TICKS, STATES))
    inputs = np.zeros((TICKS, INPUTS))
    costs = []
    for _ in range(60):
        errors = drive(loop, inputs, disturbance)
        costs.append(float(np.sum(errors**2)))
        inputs = inputs + learning_step(loop, errors, WEIGHT, EFFORT)
    assert np.all(np.diff(costs) <= 1e-9)
    free = drive(loop, np.zeros((TICKS, INPUTS)), disturbance).ravel()
    best = np.linalg.lstsq(response(loop), -free, rcond=None)[0]
    least = float(np.sum((free + response(loop) @ best) ** 2))
    assert least < 0.9 * costs[0]
    assert costs[-1] == pytest.approx(least, rel=1e-3)


def test_what_has_no_weight_changes_nothing(loop):
    errors = np.random.default_rng(9).normal(size=(TICKS + 1, OUTPUTS))
    weight = WEIGHT.copy()
    weight[10:20] = 0.0
    other = errors.copy()
    other[10:20] += 5.0
    np.testing.assert_array_equal(
        learning_step(loop, errors, weight, EFFORT), learning_step(loop, other, weight, EFFORT)
    )


def test_errors_of_another_drive_and_missing_errors_are_refused(loop):
    with pytest.raises(ValueError, match="must be"):
        learning_step(loop, np.zeros((TICKS, OUTPUTS)), WEIGHT, EFFORT)
    with pytest.raises(ValueError, match="finite"):
        learning_step(loop, np.full((TICKS + 1, OUTPUTS), np.nan), WEIGHT, EFFORT)
