"""The shipped tube as `ttempc` uses it, grown from the estimate along the default reference."""

from __future__ import annotations

import numpy as np

from proving_ground.experiments.scenario.tube_file import read_tube
from ttempc.laws.articulated_options import MpcOptions
from ttempc.limits import CommandLimits
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.feedforward import exact_feedforward
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.growing_tube import GrowingTube, reachable_inputs
from ttempc.tube.reference_tube import tracking_system
from ttempc.vehicle import Vehicle

TICKS, PERIOD_S = 680, 0.2
OPTIONS = MpcOptions()


def test_the_reserve_is_whole_along_the_figure_eight():
    """At all stages the limits hold feedforward and ancillary action at their largest."""
    vehicle = Vehicle()
    reference = Reference(figure_eight(laps=1), vehicle, ConstantSpeed(1.0))
    design, limits = read_tube("grass").design(), CommandLimits.of(vehicle, PERIOD_S)
    a, b, c = error_dynamics(reference, PERIOD_S, TICKS)
    feedforward = exact_feedforward(reference, TICKS, PERIOD_S)
    tube = GrowingTube.along(design, a, b, c, feedforward, OPTIONS)
    system = tracking_system(a, b, c, design.weights)
    inputs, rates = reachable_inputs(system, design.disturbance, OPTIONS.horizon)
    np.testing.assert_array_equal(tube.reserve, inputs)
    change = np.abs(np.diff(feedforward, axis=0, prepend=feedforward[:1]))
    assert np.all(rates + change <= limits.step)
