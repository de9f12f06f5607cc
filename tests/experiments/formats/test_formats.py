"""Foreign files: the same line from every format, refusals in one line, hostile files."""

import codecs

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidScenario, InvalidWaypoints, UnreadableFile
from proving_ground.experiments.formats.field import FieldSettings
from proving_ground.experiments.formats.read import read_foreign
from proving_ground.experiments.scenario.waypoint_file import read_waypoints
from proving_ground.testbed.geodesy import MapFrame

from . import samples

HERE = FieldSettings(origin_deg=samples.ORIGIN_DEG)


def written(folder, name, text):
    file = folder / name
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("name", samples.TEXTS)
def test_every_format_gives_the_same_line(name, tmp_path):
    waypoints = read_waypoints(written(tmp_path, name, samples.TEXTS[name]()), HERE)
    np.testing.assert_allclose(waypoints.points, samples.POINTS, atol=1e-3)
    if waypoints.speed is not None:
        np.testing.assert_allclose(waypoints.speed, samples.SPEED_MPS, atol=1e-3)


def test_a_time_log_of_isoxml_gives_the_line_at_its_resolution(tmp_path):
    waypoints = read_waypoints(samples.time_log(tmp_path), HERE)
    np.testing.assert_allclose(waypoints.points, samples.POINTS, atol=0.006)  # 1e-7 deg
    (table,) = read_foreign(tmp_path / "TLG00001.bin").tables
    np.testing.assert_allclose(np.diff(table.columns["time_s"]), 1.0)
    np.testing.assert_array_equal(table.columns["status"], 1.0)


def test_a_field_of_agopengps_gives_its_line_and_its_boundary(tmp_path):
    content = read_foreign(samples.agopengps(tmp_path))
    assert [table.name for table in content.tables] == ["AB 1"]
    assert len(content.boundary) == 1
    for place in (tmp_path, tmp_path / "TrackLines.txt"):
        points = read_waypoints(place, HERE).points
        np.testing.assert_allclose(points, samples.POINTS, atol=2e-3)  # its plane, in millimetres


@pytest.mark.parametrize("name", samples.BROKEN)
def test_a_broken_sample_is_refused_in_one_line_that_names_the_cause(name, tmp_path):
    text, message = samples.BROKEN[name]
    file = written(tmp_path, name, text)
    with pytest.raises(InvalidWaypoints) as caught:
        read_waypoints(file)
    assert str(file) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 600


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"PK\x03\x04rest", "ZIP"),
        (b"\x1f\x8brest", "gzip"),
        (b"x\0y\0", "UTF-16"),
        (b"\xff\x00\xfe\x00\x81", "binary"),
        (b"ULog\x01\x12\x35", "ULog"),
    ],
)
def test_what_is_no_text_is_named(data, message, tmp_path):
    file = tmp_path / "drive.csv"
    file.write_bytes(data)
    with pytest.raises(UnreadableFile, match=message):
        read_foreign(file)


@pytest.mark.parametrize(
    "encoded",
    [
        lambda text: codecs.BOM_UTF16_LE + text.encode("utf-16-le"),
        lambda text: codecs.BOM_UTF8 + text.encode(),
        lambda text: text.replace("\n", "\r\n").encode(),
        lambda text: ("# Grünland\n" + text).encode("cp1252"),
    ],
    ids=["utf-16", "bom", "crlf", "cp1252"],
)
def test_encodings_of_windows_are_read(encoded, tmp_path):
    file = tmp_path / "drive.csv"
    file.write_bytes(encoded(samples.csv_degrees()))
    np.testing.assert_allclose(read_waypoints(file, HERE).points, samples.POINTS, atol=1e-3)


@pytest.mark.parametrize(
    "text",
    [
        "x;y\n0;0\n5,5;0,25\n",
        "0;0\n5,5;0,25\n",
        "x\ty\n0\t0\n5,5\t0,25\n",
        "0 0\n5,5 0,25\n",
        'x,y\n"0","0"\n"5,5","0,25"\n',
    ],
)
def test_decimal_commas_are_decimal_commas(text, tmp_path):
    points = read_waypoints(written(tmp_path, "komma.csv", text)).points
    np.testing.assert_allclose(points, [[0.0, 0.0], [5.5, 0.25]])


@pytest.mark.parametrize("text", ["0,0,1,5\n5,5,2,5\n", "x,y\n0,0,1,5\n5,5,2,5\n"])
def test_decimal_commas_between_column_commas_are_refused(text, tmp_path):
    with pytest.raises(InvalidWaypoints, match="decimal commas"):
        read_waypoints(written(tmp_path, "komma.csv", text))


def test_utm_coordinates_lose_no_millimetre(tmp_path):
    offsets = np.array([[0.0, 0.0], [10.001, 0.0], [20.0, 0.003]])
    rows = offsets + np.array([479_497.332, 4_979_650.666])
    text = "\n".join(["easting,northing", *(f"{e:.3f},{n:.3f}" for e, n in rows)])
    waypoints = read_waypoints(written(tmp_path, "utm.csv", text), FieldSettings(utm="15N"))
    lengths = np.hypot(*np.diff(waypoints.points, axis=0).T)
    scale = 0.9996  # of UTM at the central meridian, 0.26 deg away
    np.testing.assert_allclose(lengths * scale, np.hypot(*np.diff(offsets, axis=0).T), atol=1e-4)
    assert np.hypot(*(np.array(waypoints.frame.origin_deg) - samples.ORIGIN_DEG)) < 2e-4


def test_metres_of_an_unknown_grid_are_about_their_middle(tmp_path):
    text = "x y\n2600000.0 1200000.0\n2600010.001 1200004.0\n"  # the Swiss grid
    waypoints = read_waypoints(written(tmp_path, "grid.csv", text))
    np.testing.assert_allclose(waypoints.points, [[-5.0005, -2.0], [5.0005, 2.0]], atol=1e-6)
    assert any("field.utm" in note for note in waypoints.notes)


def test_a_line_across_180_degrees_is_as_long_as_elsewhere(tmp_path):
    text = "lat,lon\n-17.8,179.9999\n-17.8,-179.9999\n"
    points = read_waypoints(written(tmp_path, "fiji.csv", text)).points
    elsewhere = MapFrame((-17.8, 10.0)).points([-17.8, -17.8], [9.9999, 10.0001])
    np.testing.assert_allclose(points, elsewhere, atol=1e-6)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"utm": "31U"}, "utm"),
        ({"utm": "61N"}, "utm"),
        ({"utm": "31N", "origin_deg": (50.0, 4.0), "origin_m": (5e5, 5e6)}, "one of them"),
    ],
)
def test_an_impossible_field_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        FieldSettings(**settings)


def test_metres_that_are_not_of_utm_are_refused():
    with pytest.raises(InvalidScenario, match="not in UTM"):
        FieldSettings(utm="31N").place("metres", np.array([[0.0, 0.0], [10.0, 0.0]]))


def test_one_of_several_lines_is_chosen_by_its_name(tmp_path):
    one = samples.kml()
    begin, end = one.index("<Placemark>"), one.index("</Document>")
    text = one[:end] + one[begin:end].replace("AB 1", "AB 2") + one[end:]
    file = written(tmp_path, "two.kml", text)
    with pytest.raises(InvalidWaypoints, match="AB 1, AB 2"):
        read_waypoints(file, HERE)
    assert len(read_waypoints(file, HERE, "AB 2").points) == 4
    assert len(read_waypoints(file, HERE, "2").points) == 4


def test_a_boundary_that_is_not_used_is_noted(tmp_path):
    file = written(tmp_path, "both.geojson", samples.geojson())
    assert any("boundary" in note for note in read_waypoints(file, HERE).notes)


def test_a_link_out_of_a_bag_is_not_followed(tmp_path):
    pytest.importorskip("rosbags")
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {}\n")
    (bag / "bag.mcap").symlink_to("/etc/hostname")
    with pytest.raises(UnreadableFile, match="link"):
        read_foreign(bag)
