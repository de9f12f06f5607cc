"""Projection on a polyline: nearest place, order of a path that crosses itself."""

import numpy as np

from ttempc.reference.path import Projection, figure_eight, straight

STEP_M = 0.05


def polyline(path):
    return path.pose(np.arange(0.0, path.length_m, STEP_M))[:, :2]


def test_point_beside_the_path_is_projected_along_the_normal():
    path = figure_eight(laps=1)
    projection = Projection(polyline(path))
    for s in np.arange(0.5, path.length_m - 1.0, 0.37):
        x, y, heading = path.pose(s)
        for side in (-0.8, 0.0, 0.5):
            place = projection.place(x - side * np.sin(heading), y + side * np.cos(heading))
            # Outside of a polygon, a corner is nearest over its step times offset / radius.
            assert abs(place * STEP_M - s) < 0.5 * STEP_M * 0.8 / 10.0 + 5e-4


def test_crossing_is_passed_on_the_own_branch():
    """Both branches meet in one point; the places keep growing with the way driven."""
    path = figure_eight(laps=1)
    projection = Projection(polyline(path))
    places = [projection.place(*path.pose(s)[:2]) for s in np.arange(0.0, 130.0, 0.2)]
    assert np.all(np.diff(places) > 0.0)


def test_ends_are_not_passed_and_fresh_starts_anew():
    projection = Projection(polyline(straight(2.0)))
    assert projection.place(-1.0, 0.3) == 0.0
    last = projection.place(9.0, 0.0)
    assert last == len(polyline(straight(2.0))) - 1
    assert abs(projection.fresh().place(0.5 * STEP_M, 0.0) - 0.5) < 1e-12
