"""Containment of one-step residuals in the set that was measured for single steps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.ttempc.tubes import DESIGN, PERIOD_S, REFERENCE, STEP, VEHICLE
from ttempc.errors import InvalidTube
from ttempc.laws.articulated_mpc import ArticulatedOptions, OneStepMonitor, articulated_controller
from ttempc.models.kinematics import trailer_point
from ttempc.mpc.articulated_error import error_dynamics, error_state
from ttempc.tube.reference_tube import report_rows
from ttempc.tube.sets import DisturbanceSet
from ttempc.types import Estimate

OUTPUTS = error_dynamics(REFERENCE, PERIOD_S, 60)[2][:-1, :, :7]
SKEW = np.diag([0.01, 0.01, 0.004, 0.004, 0.001, 0.001, 0.01]) + 1e-4 * np.tri(7)
SHAPES = {
    "box": STEP,
    "zonotope": DisturbanceSet(SKEW),
    "windows": DisturbanceSet(SKEW, window=7),
    "ellipsoid": DisturbanceSet(SKEW, shape="ellipsoid"),
}


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


@pytest.mark.parametrize("shape", SHAPES)
def test_a_gauge_of_one_is_the_boundary(shape):
    """Along any direction, the furthest of the set has a gauge of 1; support attained."""
    disturbance = SHAPES[shape]
    generator = np.random.default_rng(71)
    for direction in generator.normal(size=(50, 7)):
        furthest = disturbance.worst(direction[None])[0]
        assert disturbance.gauge(furthest) == pytest.approx(1.0)
        assert direction @ furthest == pytest.approx(disturbance.support(direction[None])[0])
        assert disturbance.gauge(-0.3 * furthest) == pytest.approx(0.3)


def test_what_lies_in_the_set_lies_within_the_half_widths():
    generator = np.random.default_rng(72)
    disturbance = SHAPES["zonotope"]
    design = replace(DESIGN, disturbance=disturbance)
    monitor = OneStepMonitor(design, OUTPUTS)
    for k, raw in enumerate(generator.uniform(-1.2, 1.2, size=(60, 7))):
        nominal, deviation = generator.normal(size=7), disturbance.axes @ raw
        report = monitor.report(k, nominal, deviation)
        assert report.inside == (np.abs(raw).max() <= 1.0)
        assert report.margin == pytest.approx(1.0 - np.abs(raw).max())
        np.testing.assert_allclose(report.nominal, report_rows(OUTPUTS)[k] @ nominal)
        if report.inside:
            rows = report_rows(OUTPUTS)[k]
            true_deviation = np.abs(rows @ deviation) + design.estimate_error.support(rows)
            assert np.all(true_deviation <= report.half_width + 1e-12)


def test_the_controller_reports_what_a_step_added_and_commands_the_same():
    """A jump of the estimate is the deviation of that tick; nothing jumped before."""
    options = ArticulatedOptions(tightening="none")
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
    assert margins[6] == pytest.approx(1.0 - DESIGN.disturbance.gauge(residual), abs=0.05)


def test_the_tube_reading_has_no_one_step_monitor():
    options = ArticulatedOptions(nominal="tube", tightening="none")
    controller = articulated_controller(VEHICLE, REFERENCE, PERIOD_S, options, DESIGN)
    assert controller.step(on(np.zeros(7), 0), 0).diagnostics.tube is None


def test_the_set_of_another_vehicle_is_refused():
    other = replace(VEHICLE, steering_limit_t=0.5)
    with pytest.raises(InvalidTube, match="another vehicle"):
        articulated_controller(other, replace(REFERENCE, vehicle=other), PERIOD_S, design=DESIGN)


def test_tightened_by_its_authority_no_sum_of_mpc_and_law_is_limited():
    """However far off: whatever the law adds at most, the front wheels stay off their stops."""
    options = ArticulatedOptions(tightening="saturation")
    tight = articulated_controller(VEHICLE, REFERENCE, PERIOD_S, options)
    generator = np.random.default_rng(73)
    left = []
    for k in range(60, 100):
        report = tight.step(on(generator.normal(size=7) * [2, 2, 0.3, 0.3, 0, 0, 0.3], k), k)
        front = report.diagnostics.feedforward[0] + report.diagnostics.feedback[0]
        left.append(VEHICLE.steering_limit_t - options.saturation[0] - abs(front))
    assert min(left) > -1e-9
    assert min(left) < 1e-6  # pressed to its end


def test_an_authority_that_the_feedforward_does_not_leave_free_is_refused():
    options = ArticulatedOptions(saturation=(0.2, 0.6, 0.1), tightening="saturation")
    with pytest.raises(InvalidTube, match=r"tightened set is empty: .* of the delta_i"):
        articulated_controller(VEHICLE, REFERENCE, PERIOD_S, options)
