"""Lectures of docs/lectures, run as they stand there, and the grading of their lab sheet."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

LECTURES = Path(__file__).parents[1] / "docs" / "lectures"


def run(script, folder, *arguments):
    return subprocess.run(
        [sys.executable, str(LECTURES / script), *arguments],
        cwd=folder,
        env={**os.environ, "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        check=False,
    )


def printed(script, folder):
    """Return the numbers of each line that a lecture prints, by the line's first words."""
    done = run(script, folder)
    assert done.returncode == 0, done.stderr
    lines = {}
    for line in done.stdout.splitlines():
        numbers = [float(text) for text in re.findall(r"-?\d+\.?\d*|nan", line)]
        lines.setdefault(re.split(r"[:,]|\s{2,}", line)[0], numbers)
    return lines


def test_the_mpc_of_the_lecture_needs_slip_on_a_slope_and_a_horizon(tmp_path):
    lines = printed("tracking.py", tmp_path)
    _, left_cm = lines["after 20 s"]
    assert left_cm < 1.0  # on its own model, from half a metre beside the path
    own_tractor, own_trailer, _, own_on_slope = lines["this lecture"]
    _, _, _, on_slope = lines["ttempc"]
    assert max(own_tractor, own_trailer) < 4.0
    assert on_slope < 0.7 * own_on_slope
    _, _, short_tractor, _ = lines["horizon 3 steps"][-4:]
    assert not short_tractor < 2.0 * own_tractor  # lost, or far worse
    assert lines["trailer does not count"][1] > 1.3 * own_trailer


def test_a_filter_with_slip_is_consistent_and_one_without_is_not(tmp_path):
    lines = printed("estimation.py", tmp_path)
    across_cm, _, nees, _, _, inside = lines["no slip"]
    assert nees > 2.0
    assert inside < 70.0
    for label in ("slip of the vehicle", "slip of the map"):
        with_slip_cm, _, nees, _, _, inside = lines[label]
        assert with_slip_cm < 0.6 * across_cm
        assert 0.7 < nees < 1.4
        assert 88.0 < inside <= 100.0
    east, north = lines["slip of the map at the end"]
    assert north < -1.0  # downhill: the slope rises to the north
    assert abs(east) < abs(north)


def test_a_tube_holds_on_the_field_that_it_was_measured_on(tmp_path):
    lines = printed("tubes.py", tmp_path)
    assert lines["grass"] == [100.0]
    assert lines["wet-slope"][0] < 90.0
    assert lines["believes its model"][0] > 0.0
    beyond, distance_cm = lines["with the tube"]
    assert beyond == 0.0
    half_width_cm, _ = lines["tube"]
    assert distance_cm == pytest.approx(half_width_cm, rel=0.2)


@pytest.fixture(scope="module")
def grade():
    specification = importlib.util.spec_from_file_location("grade", LECTURES / "grade.py")
    module = importlib.util.module_from_spec(specification)
    sys.modules["grade"] = module  # a dataclass looks its module up
    specification.loader.exec_module(module)
    yield module
    del sys.modules["grade"]


def test_seeds_follow_from_the_word_and_the_field(grade):
    assert grade.seeds_of("autumn", "grass") == grade.seeds_of("autumn", "grass")
    drawn = [*grade.seeds_of("autumn", "grass"), *grade.seeds_of("spring", "grass")]
    drawn += grade.seeds_of("autumn", "wet-slope")
    assert len(set(drawn)) == 6
    assert all(10000 <= seed < 100000 for seed in drawn)


def test_points_are_linear_in_the_error_and_none_for_a_lost_run(grade):
    task = grade.Task("grass", good_cm=2.0, poor_cm=8.0, points=3)
    assert grade.points_of(task, [1.0, 2.0]) == 3.0
    assert grade.points_of(task, [4.0, 6.0]) == pytest.approx(1.5)
    assert grade.points_of(task, [8.0, 30.0]) == 0.0
    assert grade.points_of(task, [1.0, None]) == 0.0


def test_grading_prints_a_line_for_each_field_and_the_sum(tmp_path):
    done = run("grade.py", tmp_path, "ttempc", "--word", "autumn")
    assert done.returncode == 0, done.stderr
    *fields, total = re.findall(r": (\d+\.\d) of (\d+) points", done.stdout)
    assert sum(float(points) for points, _ in fields) == pytest.approx(float(total[0]), abs=0.2)
    assert [float(most) for _, most in fields] == [3, 3, 4]
    assert float(total[0]) > 8.0


def test_an_unknown_controller_is_refused_in_one_line(tmp_path):
    done = run("grade.py", tmp_path, "missing:Mine", "--word", "autumn")
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1
    assert "missing" in done.stderr
