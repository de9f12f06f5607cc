"""Side slip of curves: closed form, sums of changes, what is learnt from the motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from ttempc import Guidance, Reference, Vehicle, figure_eight
from ttempc.errors import InvalidVehicle
from ttempc.layout import estimate_row
from ttempc.learning.curve_slip import CurveSlip
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.reference.reference import ConstantSpeed
from ttempc.types import Estimate, State

PERIOD_S = 0.2
SPEED = 3.0
RADIUS_M = 25.0
TRUE = np.array([0.0125, 0.027])
VEHICLE = Vehicle(compliance_t=TRUE[0], compliance_i=TRUE[1], speed_gain=6.0)
PATH = figure_eight(RADIUS_M, centre_distance_m=75.0, blend_m=10.0, laps=1)


def reference(vehicle=VEHICLE):
    return Reference(PATH, vehicle, ConstantSpeed(SPEED))


def row(state):
    point, angle = trailer_point(state, VEHICLE), hitch_angle(state)
    return estimate_row(Estimate(0.0, state, np.eye(7), point, angle))


def test_from_a_straight_into_a_circle_the_slip_changes_by_c_v2_over_r():
    grid = reference().on_grid(PERIOD_S)
    straight = int(np.flatnonzero(np.abs(grid.curvature) < 1e-9)[20])
    circle = int(np.argmax(np.abs(grid.curvature) > 0.999 / RADIUS_M)) + 15  # the trailer, too
    side = np.sign(grid.curvature[circle])
    slips = CurveSlip(reference(), PERIOD_S)
    first = min(straight, circle)
    ahead = slips.ahead(first, abs(circle - straight) + 1)
    change = (ahead[-1] if straight < circle else -ahead[-1])[:2]
    np.testing.assert_allclose(change, -side * TRUE * SPEED**2 / RADIUS_M, rtol=0.03)
    assert not ahead[:, 2].any()  # nothing of the front steering


def test_changes_add_up_to_what_lies_ahead_and_a_waiting_reference_has_none():
    slips = CurveSlip(reference(), PERIOD_S)
    state = reference().on_grid(PERIOD_S).state
    ahead = slips.ahead(0, 200)
    changes = []
    for k in range(200):
        changes.append(slips.change(k))
        slips.observe(k, row(state[k]), False)
    np.testing.assert_allclose(np.cumsum(changes, axis=0), ahead, atol=1e-12)
    assert np.abs(ahead).max() > 0.005
    assert slips.change(200).any()
    assert not slips.change(199).any()


def test_the_lead_of_the_controller_moves_what_lies_ahead():
    later = CurveSlip(reference(), PERIOD_S, lead_s=0.4)
    now = CurveSlip(reference(), PERIOD_S)
    np.testing.assert_array_equal(later.ahead(10, 30), now.ahead(12, 30))
    beyond = now.ahead(10_000, 5)
    np.testing.assert_array_equal(beyond, np.zeros((5, 3)))


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_a_wrong_compliance_is_learnt_whatever_share_of_a_slip_the_estimate_shows(share):
    """The estimate moves by what it was told and a share of the rest, as a filter's does."""
    given = replace(VEHICLE, compliance_t=0.5 * TRUE[0], compliance_i=1.6 * TRUE[1])
    slips = CurveSlip(reference(given), PERIOD_S)
    grid = reference().on_grid(PERIOD_S)
    generator = np.random.default_rng(5)
    state = grid.state[0].copy()
    told_first = slips.compliance
    first_sd = slips.compliance_sd
    for _ in range(2):  # laps
        for k, inputs in enumerate(grid.inputs):
            slips.observe(k, row(state), True)
            acceleration = SPEED * np.array([grid.yaw_rate_t[k]] * 2)
            told = slips.compliance
            shown = -(told + share * (TRUE - told)) * acceleration + 0.004
            shown = shown + 0.004 * generator.normal(size=2)
            state = advance(state, inputs, VEHICLE, PERIOD_S, np.append(shown, np.zeros(3)))
            state[State.V] = SPEED
    error = np.abs(slips.compliance - TRUE)
    assert (error < 0.7 * np.abs(told_first - TRUE)).all()
    assert (error < 3.0 * slips.compliance_sd).all()
    assert (slips.compliance_sd < first_sd).all()


def test_only_a_known_compliance_is_used_and_an_impossible_one_is_refused():
    assert Guidance(VEHICLE, reference())._pipeline.curve_slip is not None
    plain = replace(VEHICLE, compliance_t=0.0, compliance_i=0.0)
    assert Guidance(plain, reference(plain))._pipeline.curve_slip is None
    for value in (-0.01, 0.2, float("nan")):
        with pytest.raises(InvalidVehicle, match="compliance_t: got"):
            Vehicle(compliance_t=value)


def test_a_slow_reference_has_no_slip_of_curves():
    slow = Reference(PATH, VEHICLE, ConstantSpeed(1.0))
    slips = CurveSlip(slow, PERIOD_S)
    assert not slips.ahead(0, 1500).any()
