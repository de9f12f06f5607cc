import math

import numpy as np
import pytest

from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.ground.tramlines import Tramlines, parallel_lines

STRAIGHT = np.array([[-10.0, 0.0], [10.0, 0.0]])


def factor(tramlines, x, y):
    return SoilMap(1.0, (tramlines,)).cone_index(x, y)


def test_tracks_lie_left_and_right_of_the_line_and_nowhere_else():
    tramlines = Tramlines((STRAIGHT,), 1.0, 0.3, 1.5)
    y = np.array([-0.7, -0.64, -0.5, -0.36, 0.0, 0.36, 0.5, 0.64, 0.7])
    for x in (-9.0, 0.013, 3.3):
        np.testing.assert_array_equal(factor(tramlines, x, y) > 1.0, abs(abs(y) - 0.5) < 0.15)
    assert factor(tramlines, 10.2, 0.5) == 1.0


def test_tracks_cover_two_widths_of_ground_and_end_round():
    ground = terrain.flat((24.0, 24.0), 0.05)
    turned = STRAIGHT[:, :1] * np.array([math.cos(0.3), math.sin(0.3)])
    angle = np.linspace(0.0, 2.0 * math.pi, 300)
    circle = 8.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for line, length, ends in ((turned, 20.0, 2), (circle, 2.0 * math.pi * 8.0, 0)):
        raster = SoilMap(400.0, (Tramlines((line,), 1.0, 0.4, 2.0),)).rasterised(ground)
        assert set(np.unique(raster)) == {400.0, 800.0}
        area = 2.0 * 0.4 * length + ends * math.pi * 0.2**2
        assert (raster > 400.0).sum() * 0.05**2 == pytest.approx(area, rel=0.02)


def test_tracks_of_a_bent_line_stay_at_their_distance():
    angle = np.linspace(0.0, 1.0, 40)
    tramlines = Tramlines((8.0 * np.column_stack([np.cos(angle), np.sin(angle)]),), 1.0, 0.3, 3.0)
    radius = np.linspace(7.0, 9.0, 201)
    for a in (0.2, 0.5, 0.8):
        rolled = factor(tramlines, radius * math.cos(a), radius * math.sin(a)) > 1.0
        inside = abs(abs(radius - 8.0) - 0.5)
        assert rolled[inside < 0.14].all()
        assert not rolled[inside > 0.16].any()


def test_crossing_tracks_of_one_kind_count_once_and_two_kinds_twice():
    across = STRAIGHT[:, ::-1]
    once = Tramlines((STRAIGHT, across), 1.0, 0.3, 1.5)
    assert factor(once, 0.5, 0.5) == 1.5
    twice = SoilMap(1.0, (once, Tramlines((across,), 1.0, 0.3, 0.5)))
    assert twice.cone_index(0.5, 0.5) == 0.75


def test_parallel_passes_run_beside_each_other_to_the_left():
    lines = parallel_lines((1.0, 2.0), 0.5 * math.pi, 10.0, 3, 4.0)
    np.testing.assert_allclose(lines[0], [[1, 2], [1, 12]], atol=1e-12)
    np.testing.assert_allclose(lines[2], [[-7, 2], [-7, 12]], atol=1e-12)


def test_a_line_that_turns_back_or_pauses_is_a_line():
    line = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 0.0], [0.0, 0.0]])
    tramlines = Tramlines((line,), 1.0, 0.3, 1.5)
    assert factor(tramlines, 2.5, 0.5) == 1.5
    assert factor(tramlines, 2.5, 0.0) == 1.0


@pytest.mark.parametrize(
    ("lines", "track", "width", "strength"),
    [
        ((STRAIGHT,), 1.0, 0.0, 1.5),
        ((STRAIGHT,), 1.0, 1.1, 1.5),
        ((STRAIGHT,), math.nan, 0.3, 1.5),
        ((STRAIGHT,), 1.0, math.nan, 1.5),
        ((STRAIGHT,), 1.0, 0.3, 0.0),
        ((STRAIGHT,), 1.0, 0.3, math.inf),
        ((STRAIGHT[:1],), 1.0, 0.3, 1.5),
        ((STRAIGHT[[0, 0]],), 1.0, 0.3, 1.5),
        ((STRAIGHT * math.nan,), 1.0, 0.3, 1.5),
        ((), 1.0, 0.3, 1.5),
    ],
)
def test_impossible_tramlines_are_refused(lines, track, width, strength):
    with pytest.raises(InvalidField, match="tramlines"):
        Tramlines(lines, track, width, strength)


def test_tracks_narrower_than_the_grid_are_refused():
    with pytest.raises(InvalidField, match=r"soil: got tramlines 0\.05 m wide"):
        SoilMap(1.0, (Tramlines((STRAIGHT,), 1.0, 0.05, 1.5),)).rasterised(terrain.flat())
