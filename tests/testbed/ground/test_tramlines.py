import math

import numpy as np
import pytest
from proving_ground.testbed.errors import InvalidField
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap, Tracks, Tramlines, parallel_lines
from pydantic import ValidationError

TRACKS = Tracks(track_m=1.0, width_m=0.3, strength_factor=1.5)
STRAIGHT = np.array([[-10.0, 0.0], [10.0, 0.0]])


def factor(tramlines, x, y):
    return SoilMap(1.0, (tramlines,)).cone_index(x, y)


def test_tracks_lie_left_and_right_of_the_line_and_nowhere_else():
    tramlines = Tramlines((STRAIGHT,), TRACKS)
    y = np.array([-0.7, -0.64, -0.5, -0.36, 0.0, 0.36, 0.5, 0.64, 0.7])
    for x in (-9.0, 0.013, 3.3):
        np.testing.assert_array_equal(factor(tramlines, x, y) > 1.0, abs(abs(y) - 0.5) < 0.15)
    assert factor(tramlines, 10.2, 0.5) == 1.0


def test_tracks_cover_two_widths_of_ground_and_end_round():
    ground = terrain.flat((24.0, 24.0), 0.05)
    tracks = Tracks(track_m=1.0, width_m=0.4, strength_factor=2.0)
    turned = STRAIGHT[:, :1] * np.array([math.cos(0.3), math.sin(0.3)])
    angle = np.linspace(0.0, 2.0 * math.pi, 300)
    circle = 8.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    for line, length, ends in ((turned, 20.0, 2), (circle, 2.0 * math.pi * 8.0, 0)):
        raster = SoilMap(400.0, (Tramlines((line,), tracks),)).rasterised(ground)
        assert set(np.unique(raster)) == {400.0, 800.0}
        area = 2.0 * 0.4 * length + ends * math.pi * 0.2**2
        assert (raster > 400.0).sum() * 0.05**2 == pytest.approx(area, rel=0.02)


def test_tracks_of_a_bent_line_stay_at_their_distance():
    angle = np.linspace(0.0, 1.0, 40)
    line = 8.0 * np.column_stack([np.cos(angle), np.sin(angle)])
    tramlines = Tramlines((line,), TRACKS)
    radius = np.linspace(7.0, 9.0, 201)
    for a in (0.2, 0.5, 0.8):
        rolled = factor(tramlines, radius * math.cos(a), radius * math.sin(a)) > 1.0
        inside = abs(abs(radius - 8.0) - 0.5)
        assert rolled[inside < 0.14].all()
        assert not rolled[inside > 0.16].any()


def test_crossing_tracks_of_one_kind_count_once_and_two_kinds_twice():
    across = STRAIGHT[:, ::-1]
    once = Tramlines((STRAIGHT, across), TRACKS)
    assert factor(once, 0.5, 0.5) == 1.5
    loose = Tramlines((across,), Tracks(track_m=1.0, strength_factor=0.5))
    twice = SoilMap(1.0, (once, loose))
    assert twice.cone_index(0.5, 0.5) == 0.75


def test_parallel_passes_run_beside_each_other_to_the_left():
    lines = parallel_lines((1.0, 2.0), 0.5 * math.pi, 10.0, 3, 4.0)
    np.testing.assert_allclose(lines[0], [[1, 2], [1, 12]], atol=1e-12)
    np.testing.assert_allclose(lines[2], [[-7, 2], [-7, 12]], atol=1e-12)


def test_a_line_that_turns_back_or_pauses_is_a_line():
    line = np.array([[0.0, 0.0], [5.0, 0.0], [5.0, 0.0], [0.0, 0.0]])
    tramlines = Tramlines((line,), TRACKS)
    assert factor(tramlines, 2.5, 0.5) == 1.5
    assert factor(tramlines, 2.5, 0.0) == 1.0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width_m": 0.0}, r"width_m\n.*greater than or equal to 0\.001"),
        ({"width_m": 1.1}, r"tracks 1\.1 m wide and 1\.0 m apart"),
        ({"track_m": math.nan}, r"track_m\n.*finite"),
        ({"width_m": math.nan}, r"width_m\n.*finite"),
        ({"strength_factor": 0.0}, r"strength_factor\n.*greater than or equal to 0\.05"),
        ({"strength_factor": math.inf}, r"strength_factor\n.*finite"),
    ],
)
def test_impossible_tracks_are_refused(changes, message):
    with pytest.raises(ValidationError, match=message):
        Tracks(**({"track_m": 1.0} | changes))


@pytest.mark.parametrize(
    "lines", [(STRAIGHT[:1],), (STRAIGHT[[0, 0]],), (STRAIGHT * math.nan,), ()]
)
def test_impossible_lines_are_refused(lines):
    with pytest.raises(InvalidField, match="tramlines"):
        Tramlines(lines, TRACKS)


def test_tracks_narrower_than_the_grid_are_refused():
    with pytest.raises(InvalidField, match=r"soil: got tramlines 0\.05 m wide"):
        SoilMap(1.0, (Tramlines((STRAIGHT,), Tracks(width_m=0.05)),)).rasterised(terrain.flat())
