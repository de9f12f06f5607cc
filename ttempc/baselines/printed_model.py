"""Printed model of tractor and trailer along the horizon of an NMPC, with its derivatives."""

import math
from typing import Final

import numpy as np

from ..jit import cached_njit
from ..models.printed import COLUMNS, FACTORS, STATES, UNKNOWNS, advance_printed, printed_parameters
from ..types import FloatArray, Input
from ..vehicle import Vehicle
from .nmpc_model import PRINTED, Block, Model, Task, linear_map, planned_inputs

_M: Final = len(Input)
OUTPUTS: Final = 5
_SPEED: Final = 6  # place of v in state and target


def printed_model(vehicle: Vehicle, period_s: float) -> Model:
    """Return the printed model with inputs delta_t, lambda, hp; slip factors and beta are given.

    `Task.disturbance` holds mu, kappa, eta, beta and nothing. beta stays as it was measured. The
    targets are x, y, psi of tractor and trailer and the speed of the rims; the outputs, (5,), are
    target less position in the frames of the targets, then of the speed.
    """
    block = Block(np.arange(_M), True, True, np.arange(OUTPUTS))
    return Model(PRINTED, printed_parameters(vehicle), period_s, 1, block)


@cached_njit(error_model="numpy", boundscheck=False)
def printed_horizon(
    model: Model, task: Task, steps: FloatArray, errors: FloatArray, jacobian: FloatArray
) -> None:
    """Write the outputs along the horizon into `errors` (Np, 5), and their derivatives by `steps`.

    The derivatives are (Np, 5, 3 Nc), see `printed_model`.
    """
    now = task.state.copy()
    by_given = np.empty((STATES, COLUMNS))
    before = np.zeros((STATES, steps.size))
    after = np.zeros((STATES, steps.size))
    by_end = np.zeros((OUTPUTS, STATES))
    steering = np.empty(4)
    inputs = np.empty_like(task.feedforward)
    planned_inputs(task, model.block.inputs, steps, inputs)
    for j in range(len(inputs)):
        factors = task.disturbance[j, :FACTORS]
        beta = task.disturbance[j, FACTORS]
        steering[0] = inputs[j, Input.DELTA_T]
        steering[1] = inputs[j, Input.DELTA_I] - beta  # delta_i = lambda - beta
        steering[2] = inputs[j, Input.HP]
        steering[-1] = beta
        advance_printed(now, steering, factors, model.parameters, model.period_s, by_given)
        _propagate(by_given, j, before, after)
        pose = task.poses[j]
        for body in range(2):
            first = 3 * body
            dx = pose[first] - now[first]
            dy = pose[first + 1] - now[first + 1]
            cos = math.cos(pose[first + 2])
            sin = math.sin(pose[first + 2])
            along = 2 * body
            across = along + 1
            errors[j, along] = cos * dx + sin * dy
            errors[j, across] = cos * dy - sin * dx
            by_end[along, first] = -cos
            by_end[along, first + 1] = -sin
            by_end[across, first] = sin
            by_end[across, first + 1] = -cos
        errors[j, OUTPUTS - 1] = pose[_SPEED] - now[_SPEED]
        by_end[OUTPUTS - 1, _SPEED] = -1.0
        linear_map(by_end, after, steps.size, jacobian[j])
        before, after = after, before


@cached_njit(error_model="numpy", boundscheck=False)
def _propagate(by_given: FloatArray, period: int, before: FloatArray, after: FloatArray) -> None:
    """Write d state / d steps at the end of a `period` into `after` (7, 3 Nc).

    `before` is the same at its start; d u / d step i = -1 from period i on.
    """
    filled = min((period + 1) * _M, after.shape[1])
    linear_map(by_given[:, :STATES], before, filled, after)
    for row in range(STATES):
        for i in range(filled):
            after[row, i] -= by_given[row, UNKNOWNS + i % _M]
