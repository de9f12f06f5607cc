"""Articulated model on CasADi's symbols against `ttempc.models.kinematics`."""

from __future__ import annotations

import sys

import casadi as ca
import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.models.test_kinematics import OTHER, VEHICLE, random_cases
from tests.ttempc.numeric import central_differences
from ttempc.baselines.nmpc_model import (
    TRACTOR,
    TRAILER,
    WHOLE,
    ArticulatedExpressions,
    HorizonModel,
)
from ttempc.errors import MissingPackage
from ttempc.guidance.controllers import make_controller
from ttempc.models.kinematics import articulated, trailer_point
from ttempc.mpc.prediction import rotation
from ttempc.reference.path import straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.types import State

PERIOD_S = 0.2
HORIZON = 20


@pytest.mark.parametrize("vehicle", [VEHICLE, OTHER])
@pytest.mark.parametrize("steering_step", [0.02, 2.0])  # within and far beyond the rate limits
def test_rates_are_those_of_the_numpy_model(vehicle, steering_step):
    arguments = [ca.SX.sym(name, size) for name, size in (("x", 7), ("u", 3), ("w", 5))]
    rate = ca.Function("rate", arguments, [ArticulatedExpressions(vehicle).rate(*arguments)])
    for state, inputs, disturbance in random_cases(steering_step=steering_step):
        expected = articulated(state, inputs, vehicle, disturbance)
        rates = np.asarray(rate(state, inputs, disturbance)).reshape(-1)
        np.testing.assert_allclose(rates, expected, rtol=1e-12, atol=1e-12)


def gentle(generator):
    """Return a state, inputs (Np, 3), a disturbance and poses (Np, 6) to predict with."""
    state = generator.normal(size=7) * [3, 3, 1, 0.1, 0.1, 0.1, 0.1]
    state[State.PSI_I] += state[State.PSI_T]
    state[State.V] += 1.0
    inputs = np.cumsum(generator.uniform(-0.1, 0.1, size=(HORIZON, 3)), axis=0)
    inputs[:, 2] += 0.7
    disturbance = generator.normal(size=5) * [0.05, 0.05, 0.02, 0.05, 0.0]
    return state, inputs, disturbance, generator.normal(size=(HORIZON, 6))


def exact(state, inputs, disturbance, poses, vehicle):
    """Return the errors along the horizon by fine steps of the numpy model, (Np, 4)."""
    errors = []
    for held, pose in zip(inputs, poses, strict=True):
        for _ in range(20):
            state = advance(state, held, vehicle, PERIOD_S / 20, disturbance)
        error = [
            rotation(-psi) @ (pose[i : i + 2] - point)
            for i, psi, point in (
                (0, pose[2], state[:2]),
                (3, pose[5], trailer_point(state, vehicle)),
            )
        ]
        errors.append(np.concatenate(error))
    return np.array(errors)


def test_coarse_steps_predict_the_position_errors_to_a_millimetre():
    generator = np.random.default_rng(7)
    model = HorizonModel(ArticulatedExpressions(VEHICLE), WHOLE, HORIZON, PERIOD_S)
    for _ in range(5):
        state, inputs, disturbance, poses = gentle(generator)
        model.start(state, disturbance, poses)
        model.evaluate(inputs)
        expected = exact(state, inputs, disturbance, poses, VEHICLE)
        np.testing.assert_allclose(model.errors, expected, atol=1e-3)


@pytest.mark.parametrize("subsystem", [WHOLE, TRACTOR, TRAILER])
def test_derivatives_along_the_horizon(subsystem):
    """The last error by the first input, through all stages, and by central differences."""
    state, inputs, disturbance, poses = gentle(np.random.default_rng(8))
    inputs[:, :2] *= 0.2  # no rate limit, whose kinks have no derivative
    model = HorizonModel(ArticulatedExpressions(VEHICLE), subsystem, HORIZON, PERIOD_S)
    model.start(state, disturbance, poses)
    own = list(subsystem.inputs)

    def last_error(first):
        changed = inputs.copy()
        changed[0, own] = first
        model.evaluate(changed)
        return model.errors[-1].copy()

    numeric = central_differences(last_error, inputs[0, own])
    model.evaluate(inputs)
    by_input = model.by_input[0]
    for by_state in model.by_state[1:]:
        by_input = by_state @ by_input
    np.testing.assert_allclose(model.error_by_state[-1] @ by_input, numeric, atol=1e-7)


@pytest.mark.parametrize("name", ["nmpc", "nmpc-rti", "nmpc-decentralised", "nmpc-distributed"])
def test_refused_in_one_line_where_casadi_is_not_installed(name, monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    reference = Reference(straight(30.0), VEHICLE, ConstantSpeed(1.0))
    with pytest.raises(MissingPackage, match=r"pip install 'ttempc\[baselines\]'"):
        make_controller(name, VEHICLE, reference, PERIOD_S)
