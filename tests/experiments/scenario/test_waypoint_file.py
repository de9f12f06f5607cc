"""Waypoint files: formats and refusals."""

import json
import math

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidWaypoints
from proving_ground.experiments.formats.field import FieldSettings
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.scenario.waypoint_file import read_waypoints

POINTS = [(0.0, 0.0, 1.0), (5.0, 0.5, 0.8), (10.0, 2.0, 0.6)]


def written(folder, text, name="route.csv"):
    file = folder / name
    file.write_text(text)
    return file


def test_all_formats_of_columns_give_the_same_waypoints(tmp_path):
    for text in (
        "0,0,1\n5,0.5,0.8\n10,2,0.6\n",
        "0 0 1\n\n5\t0.5 0.8\n10 2 .6",
        "x;y;speed\n0;0;1\n5;0.5;0.8\n10;2;0.6\n",
        '"speed_mps", "x_m", "y_m"\n1,0,0\n0.8,5,0.5\n0.6,10,2\n',
        "# x y v\n0 0 1\n# a comment\n5 0.5 0.8\n10 2 0.6\n",
        "name,Easting,Northing,Velocity\na,0,0,1\nb,5,0.5,0.8\nc,10,2,0.6\n",
    ):
        waypoints = read_waypoints(written(tmp_path, text))
        np.testing.assert_allclose(waypoints.points, np.array(POINTS)[:, :2])
        np.testing.assert_allclose(waypoints.speed, np.array(POINTS)[:, 2])


def test_invalid_columns_are_refused_with_their_line(tmp_path):
    for text, message in (
        ("", "empty"),
        ("0 0\n1 0 0\n", "line 2: got 3 columns"),
        ("0 0 0 0\n", "line 1: got 4 columns"),
        ("0 0\n1 one\n", "line 2: y is 'one'"),
        ("a b\n0 0\n", "line 1: header a b"),
    ):
        with pytest.raises(InvalidWaypoints) as caught:
            read_waypoints(written(tmp_path, text))
        assert "route.csv: " in str(caught.value)
        assert message in str(caught.value)


def geojson(coordinates, wrap="Feature"):
    line = {"type": "LineString", "coordinates": coordinates}
    feature = {"type": "Feature", "properties": {}, "geometry": line}
    wrapped = {
        "LineString": line,
        "Feature": feature,
        "FeatureCollection": {"type": "FeatureCollection", "features": [feature]},
    }
    return json.dumps(wrapped[wrap])


def test_geojson_is_east_and_north_of_its_middle_or_of_an_origin(tmp_path):
    places = [[4.7, 50.88], [4.701, 50.88, 30.0], [4.701, 50.881]]
    for wrap in ("LineString", "Feature", "FeatureCollection"):
        file = written(tmp_path, geojson(places, wrap), "route.geojson")
        points = read_waypoints(file).points
        np.testing.assert_allclose(points.min(axis=0), -points.max(axis=0), atol=1e-3)
        moved = read_waypoints(file, FieldSettings(origin_deg=(50.8801, 4.7))).points
        np.testing.assert_allclose(np.diff(moved, axis=0), np.diff(points, axis=0), atol=1e-3)
        assert moved[0, 1] == pytest.approx(-11.12, abs=0.02)


def test_invalid_geojson_is_refused(tmp_path):
    for text, message in (
        ("{", "JSON"),
        ('{"type": "Point", "coordinates": [1, 2]}', "without a line"),
        (geojson([]), "coordinates"),
        (geojson([[4.7, 50.0], [4.7, 95.0]]), r"point 1 is \[4.7, 95.0\]"),
        (geojson([[4.7]]), "point 0"),
        (geojson([[4.7, None]]), "point 0"),
    ):
        with pytest.raises(InvalidWaypoints, match=message):
            read_waypoints(written(tmp_path, text, "route.geojson"))


def scenario(folder, extra=""):
    return written(
        folder,
        f"[path]\nkind = 'file'\nfile = 'bend.csv'\n{extra}\n[controller]\nname = 'ttempc-nominal'",
        "mine.toml",
    )


def bend(radius, speed=1.0):
    turn = np.linspace(0.0, 0.8, 40)
    arc = [(6.0 + radius * math.sin(a), radius * (1.0 - math.cos(a)), speed) for a in turn]
    return "\n".join(f"{x} {y} {v}" for x, y, v in [(0.0, 0.0, 1.0), (3.0, 0.0, 1.0), *arc])


def test_a_path_beside_the_scenario_is_driven_at_its_speeds(tmp_path, monkeypatch):
    written(tmp_path, bend(12.0, speed=0.7), "bend.csv")
    file = scenario(tmp_path)
    monkeypatch.chdir("/")
    summary, record = simulate(*load(str(file)), seed=2)
    assert summary.status == "completed"
    assert summary.tracking.all.tractor.max_m < 0.15
    assert any("42 points of bend.csv, driven within" in event.text for event in record.events)


def test_bad_paths_get_one_line_with_the_place_and_nothing_is_written(tmp_path, capsys):
    for number, (content, extra, message) in enumerate(
        (
            (None, "", "bend.csv: cannot be read"),
            (bend(0.8), "", "reference too fast at s ="),
            (bend(12.0, speed=-1.0), "", "-1 m/s at point 2: a path is driven in one gear; split"),
            ("0 0 -1\n9 0 -1\n", "", "above 0 and path.reverse = true"),
            ("0 0\n10 0\n0 0.1\n", "", "split it into a forward path"),
            (bend(12.0, speed=3.0), "", "1.4 m/s"),
            ("0 0\n38 0\n", "", "leaves at s = 36."),
            ("0 0\n60 0\n", "", "point 1 of 2 at x = 60, y = 0 m"),
            ("0 0\n10 0\n", "max_deviation_m = 0.0", "path.max_deviation_m: "),
        )
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        if content is not None:
            written(folder, content, "bend.csv")
        file = scenario(folder, extra)
        before = sorted(folder.iterdir())
        assert main(["run", str(file), "--out", str(folder / "new")]) == 2
        printed = capsys.readouterr().err
        assert message in printed
        assert len(printed.strip().splitlines()) == 1
        assert sorted(folder.iterdir()) == before


def test_what_a_recorder_leaves_is_driven_with_a_note(tmp_path):
    """Repeated points and those of a standing vehicle, with the speeds there."""
    lines = bend(12.0).splitlines()
    standing = [" ".join([*lines[20].split()[:2], "0.0"])] * 30
    written(tmp_path, "\n".join([*lines[:20], *standing, *lines[20:]]), "bend.csv")
    mission = load(str(scenario(tmp_path)))[1].mission()
    assert any("30 points too near to another dropped" in note for note in mission.notes)
    assert any("30 points driven at that speed" in note for note in mission.notes)
    _, speed, _ = mission.speed.travel(np.linspace(0.0, 60.0, 601))
    assert speed.min() > 0.0


def test_errors_are_also_those_to_the_line_as_given(tmp_path):
    """A corner of 10 deg: the reference cuts it within 10 cm, and both are in the summary."""
    corner = [(0.0, 0.0), (9.0, 0.0), (18.0, 18.0 * math.tan(math.radians(5.0)))]
    written(tmp_path, "\n".join(f"{x} {y}" for x, y in corner), "bend.csv")
    summary, record = simulate(*load(str(scenario(tmp_path))), seed=2)
    assert summary.line is not None
    assert summary.corridor is None
    reference = record["/line"]["tractor_reference_m"]
    assert summary.line.tractor_reference.max_m == pytest.approx(np.abs(reference).max())
    assert 0.0 < summary.line.tractor_reference.max_m <= 0.1
    offset = record["/line"]["tractor_m"][200]
    x, y = (record["/state"][name][200] for name in ("x_t_m", "y_t_m"))
    ahead = 1 if x > 9.0 else 0
    (x_0, y_0), (x_1, y_1) = corner[ahead : ahead + 2]
    length = math.hypot(x_1 - x_0, y_1 - y_0)
    expected = ((x_1 - x_0) * (y - y_0) - (y_1 - y_0) * (x - x_0)) / length
    assert offset == pytest.approx(expected, abs=0.005)


def test_a_u_turn_of_5_m_is_driven_with_the_trailer_beside_it(tmp_path):
    angle = np.linspace(0.0, math.pi, 40)
    arc = [(5.0 * math.sin(a), -5.0 * math.cos(a)) for a in angle]
    points = [
        *((float(x), -5.0) for x in range(-10, 0)),
        *arc,
        *((-1.0 - x, 5.0) for x in range(9)),
    ]
    written(tmp_path, "\n".join(f"{x} {y}" for x, y in points), "bend.csv")
    summary, record = simulate(*load(str(scenario(tmp_path))), seed=7)
    assert summary.status == "completed"
    assert any("leaves the line of the tractor by up to" in event.text for event in record.events)
    line = summary.line
    assert line.tractor.p95_m < 0.06
    assert 0.05 < line.trailer_reference.max_m < 0.2
    assert summary.tracking.all.trailer.cross_p95_m < 0.06  # to its own reference
