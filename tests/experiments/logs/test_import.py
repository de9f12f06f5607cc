"""Records of other programs: own log back within a millimetre, commands on imports, refusals."""

import math

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import UnreadableFile
from proving_ground.experiments.formats.mapping import FormatMap, read_map
from proving_ground.experiments.logs.import_log import import_log
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.geodesy import MapFrame

from proving_ground import read_log

from ..formats import samples

FRAME = MapFrame((-33.87, 151.2))  # Sydney
RADIUS_M = 20.0
SPEED_MPS = 1.5
LEVER_M = (1.2, -0.3, 2.5)


def circle(duration_s=40.0, rate_hz=10.0):
    """Return times, axle points and headings of a circle to the left."""
    times = np.arange(0.0, duration_s, 1.0 / rate_hz)
    angle = SPEED_MPS / RADIUS_M * times
    points = RADIUS_M * np.column_stack([np.sin(angle), 1.0 - np.cos(angle)])
    return times, points, angle


def antennas(points, yaw):
    ahead, left, _ = LEVER_M
    offset = np.column_stack(
        [ahead * np.cos(yaw) - left * np.sin(yaw), ahead * np.sin(yaw) + left * np.cos(yaw)]
    )
    return points + offset


def panda(file):
    times, points, yaw = circle()
    lines = []
    for time_s, (lat, lon), angle in zip(
        times, FRAME.degrees(antennas(points, yaw)), yaw, strict=True
    ):
        minutes, seconds = divmod(time_s, 60.0)
        heading = round(10.0 * ((90.0 - math.degrees(angle)) % 360.0))
        lines.append(
            samples.sentence(
                f"PANDA,08{int(minutes):02d}{seconds:05.2f},{samples.place(lat, lon)},4,12,0.8,"
                f"20,1.0,{SPEED_MPS / 0.514444:.4f},{heading},0,0,0"
            )
        )
    file.write_text("".join(lines))
    return file


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Return the log of a circle that $PANDA recorded, and the lines of the console."""
    folder = tmp_path_factory.mktemp("panda")
    log = folder / "circle.mcap"
    done = import_log(panda(folder / "panda.txt"), log, FormatMap(antenna_m=LEVER_M))
    return log, done.lines


def test_the_axle_point_of_an_antenna_is_where_the_lever_arm_says(imported):
    log, _ = imported
    state = read_log(log)["/state"]
    middle = state.columns("x_t_m", "y_t_m")
    radii = np.hypot(*(middle - middle[:200].mean(axis=0)).T)
    at = np.round(state.time_s, 2)
    _, points, _ = circle()
    shift = middle[0] - points[0]
    every = np.flatnonzero(np.isclose(at % 0.2, 0.0) | np.isclose(at % 0.2, 0.2))
    expected = points[np.round(10.0 * at[every]).astype(int)] + shift
    np.testing.assert_allclose(middle[every], expected, atol=5e-3)  # headings in 0.1 deg
    assert radii.max() > 1.0


def test_a_passive_trailer_settles_where_geometry_says(imported):
    """Without trailer steering, r_i^2 = r_t^2 + a^2 - d'^2 in a steady turn."""
    log, _ = imported
    state = read_log(log)["/state"]
    centre = state.columns("x_t_m", "y_t_m")[0] + [0.0, RADIUS_M]
    last = state.columns("x_i_m", "y_i_m")[-20:] - centre
    a, behind = 0.3, 0.8 + 1.3
    expected = math.sqrt(RADIUS_M**2 + a**2 - behind**2)
    np.testing.assert_allclose(np.hypot(*last.T), expected, atol=0.03)


def test_what_is_not_measured_is_said(imported, capsys):
    log, lines = imported
    for text in ("steering_tractor", "hitch", "gnss_trailer"):
        assert any("not measured" in line and text in line for line in lines)
    assert main(["log", "info", str(log)]) == 0
    assert "not measured" in capsys.readouterr().out


def test_the_commands_on_logs_take_an_import(imported, tmp_path, capsys):
    log, _ = imported
    assert main(["report", str(log), "-o", str(tmp_path / "page.html")]) == 0
    assert main(["log", "replay", str(log)]) == 0
    picture = tmp_path / "plan.png"
    command = ["render", str(log), "--camera", "plan", "--at", "10", "-o", str(picture)]
    assert main(command) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    capsys.readouterr()
    assert main(["compare", str(log), str(log.parent / "other.mcap")]) == 2


def test_the_origin_of_the_field_is_that_of_the_map(tmp_path):
    file = panda(tmp_path / "panda.txt")
    (tmp_path / "map.toml").write_text(
        "antenna_m = [1.2, -0.3, 2.5]\n[field]\norigin_deg = [-33.8701, 151.2]\n"
    )
    import_log(file, tmp_path / "a.mcap", read_map(tmp_path / "map.toml"))
    record = read_log(tmp_path / "a.mcap")
    assert record.metadata["origin_deg"] == "-33.8701, 151.2"
    assert record["/state"]["y_t_m"][0] == pytest.approx(11.09, abs=0.05)


def test_an_own_log_comes_back_within_a_millimetre(short_runs, tmp_path, monkeypatch):
    """Log -> rosbag2 -> log; the line is that of the scenario, and so are the errors."""
    pytest.importorskip("rosbags")
    log = short_runs / "nominal" / "log.mcap"
    monkeypatch.syspath_prepend(str(samples.EXAMPLES))
    import ros2_bag

    ros2_bag.convert(log, tmp_path / "bag")
    name, scenario = load(str(short_runs / "nominal" / "scenario.toml"))
    import_log(tmp_path / "bag", tmp_path / "back.mcap", FormatMap(), scenario, name=name)
    record, back = read_log(log), read_log(tmp_path / "back.mcap")
    _, rows, others = np.intersect1d(
        np.round(record["/state"].time_s, 6),
        np.round(back["/state"].time_s, 6),
        return_indices=True,
    )
    assert len(rows) > 0.9 * len(record["/state"])
    for field in ("x_t_m", "y_t_m", "x_i_m", "y_i_m"):
        np.testing.assert_allclose(
            back["/state"][field][others], record["/state"][field][rows], atol=1e-3
        )
    cross = [each["/error"]["trailer_cross_m"] for each in (record, back)]
    np.testing.assert_allclose(cross[1][others], cross[0][rows], atol=5e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lat,lon\n44.97,-93.26\n44.98,-93.26\n", "has no times"),
        ("time,x,y\n0,0,0\n1,1,0\n2,2,0\n19,9,0\n20,10,0\n", "longest gap"),
        ("time,x,y\n0,0,0\n1,0,0\n2,0,0\n3,0,0\n", "moves too little"),
    ],
)
def test_a_record_with_too_little_is_refused(text, message, tmp_path):
    file = tmp_path / "record.csv"
    file.write_text(text)
    with pytest.raises(UnreadableFile, match=message):
        import_log(file, tmp_path / "new.mcap", FormatMap())
    assert not (tmp_path / "new.mcap").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colums = {}\n", "colums"),
        ("decimal = ';'\n", "decimal"),
        ("[columns]\nspeed_mph = 'v'\n", "speed_mph"),
    ],
)
def test_a_wrong_map_is_refused_with_its_key(text, message, tmp_path):
    (tmp_path / "map.toml").write_text(text)
    (tmp_path / "r.csv").write_text("time,x,y,v\n0,0,0,1\n1,1,0,1\n2,2,0,1\n")
    with pytest.raises(UnreadableFile, match=message):
        import_log(tmp_path / "r.csv", tmp_path / "new.mcap", read_map(tmp_path / "map.toml"))
