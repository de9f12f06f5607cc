"""Shipped tubes along the default reference, grown from the estimate as `ttempc` uses them, too."""

from __future__ import annotations

import numpy as np
from proving_ground.experiments.results.containment import QUANTITIES
from proving_ground.experiments.scenario.tube_file import read_tube, shipped_tubes

from ttempc.laws.articulated_mpc import MpcOptions
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference, exact_feedforward
from ttempc.tube.reference_tube import GrowingTube, ReferenceTube, steered_system
from ttempc.vehicle import CommandLimits, Vehicle

TICKS, PERIOD_S = 680, 0.2
OPTIONS = MpcOptions()


REFERENCE_PATH = Reference(figure_eight(laps=1), Vehicle(), ConstantSpeed(1.0))


def test_the_reserve_is_whole_along_the_figure_eight():
    """At all stages the limits hold feedforward and ancillary action at their largest."""
    design, limits = read_tube("grass").design(), CommandLimits.of(Vehicle(), PERIOD_S)
    a, b, c = error_dynamics(REFERENCE_PATH, PERIOD_S, TICKS)
    feedforward = exact_feedforward(REFERENCE_PATH, TICKS, PERIOD_S)
    tube = GrowingTube.along(design, a, b, c, feedforward, OPTIONS)
    _, inputs, rates = steered_system(design, a, b, c, limits, OPTIONS.horizon)
    np.testing.assert_array_equal(tube.reserve, inputs)
    change = np.abs(np.diff(feedforward, axis=0, prepend=feedforward[:1]))
    assert np.all(rates + change <= limits.step)


def test_shipped_tubes_fit_the_default_vehicle():
    assert "grass" in shipped_tubes()
    for name in shipped_tubes():
        along = ReferenceTube.along(read_tube(name).design(), REFERENCE_PATH, TICKS)
        assert np.all(along.free_share > 0.0)


def test_the_certified_tube_of_grass_is_as_narrow_as_promised():
    along = ReferenceTube.along(read_tube("grass").design(), REFERENCE_PATH, TICKS)
    cross = [QUANTITIES.index(name) for name in ("y_t_e_m", "y_i_e_m")]
    assert along.half_widths[:, cross].max() <= 0.30  # under the published side force law
    on_the_curve = np.abs(REFERENCE_PATH.at(0.2 * np.arange(TICKS)).curvature) > 0.0999
    assert along.free_share[on_the_curve, :2].min() >= 0.199
