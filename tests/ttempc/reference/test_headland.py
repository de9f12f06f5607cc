"""Headland patterns: places of the passes, and kinds and curvatures of the turns."""

import math

import numpy as np
import pytest

from ttempc.errors import InvalidPath
from ttempc.reference.headland import bend, headland
from ttempc.reference.path import Path
from ttempc.reference.reference import check_drivable
from ttempc.vehicle import Vehicle

WIDTHS = (0.5, 3.0, 9.0, 14.0, 15.0, 16.0, 16.5, 30.0)  # loops, half circles, U's at R = 7 m


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("blend", [1.0, 4.0])
def test_passes_are_parallel_and_lie_a_width_apart(width, blend):
    path = headland(20.0, width, 5, 7.0, blend)
    s = np.linspace(0.0, path.lap_m, 20001)
    x, y, heading = path.pose(s).T
    for index in range(5):
        y_pass = (index - 2) * width
        on_pass = (np.abs(y - y_pass) < 1e-6) & (np.abs(x) < 10.0) & (path.curvature(s) == 0.0)
        assert np.ptp(x[on_pass]) == pytest.approx(20.0, abs=0.1)
        np.testing.assert_allclose(np.cos(heading[on_pass]), (-1.0) ** index, atol=1e-9)
    np.testing.assert_allclose(path.pose(0.0), [-10.0, -2.0 * width, 0.0], atol=1e-12)
    np.testing.assert_allclose(path.pose(path.lap_m)[:2], [10.0, 2.0 * width], atol=1e-9)


@pytest.mark.parametrize("width", WIDTHS)
def test_turns_respect_radius_and_blend_and_are_drivable(width):
    path = headland(20.0, width, 3, 7.0, 2.0)
    s = np.linspace(0.0, path.lap_m, 20001)
    assert np.abs(path.curvature(s)).max() <= 1.0 / 7.0 + 1e-12
    assert np.abs(path.curvature_derivative(s)).max() <= 1.0 / 14.0 + 1e-9
    check_drivable(path, Vehicle())


def test_the_width_decides_the_kind_of_turn():
    def kind(width):
        path = headland(20.0, width, 2, 7.0, 2.0)
        s = np.linspace(20.0, path.lap_m - 20.0, 4001)[1:-1]
        kappa = path.curvature(s)
        if kappa.min() < -1e-9:
            return "loop"
        return "U" if np.sum(kappa == 0.0) > 1 else "half circle"

    kinds = [kind(width) for width in (4.0, 13.0, 15.0, 17.0, 40.0)]
    assert kinds == ["loop", "loop", "half circle", "U", "U"]


@pytest.mark.parametrize("angle", [0.01, -0.2, 0.5, math.pi, -4.0])
def test_a_bend_turns_by_its_angle_from_straight_to_straight(angle):
    path = Path(bend(angle, 7.0, 2.0))
    assert path.pose(path.lap_m)[2] == pytest.approx(angle, abs=1e-12)
    assert path.curvature(0.0) == path.curvature(path.lap_m) == 0.0


def test_one_pass_is_a_straight():
    path = headland(20.0, 4.0, 1)
    assert path.lap_m == 20.0
    assert not np.any(path.curvature(np.linspace(0.0, path.lap_m, 50)))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"width_m": 0.0}, "width_m"),
        ({"length_m": math.nan}, "length_m"),
        ({"radius_m": -7.0}, "radius_m"),
        ({"blend_m": math.inf}, "blend_m"),
        ({"passes": 0}, "passes"),
    ],
)
def test_impossible_patterns_are_refused(arguments, message):
    with pytest.raises(InvalidPath, match=message):
        headland(**arguments)
