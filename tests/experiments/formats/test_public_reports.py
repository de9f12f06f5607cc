"""Inputs of public bug reports of other programs: read rightly, or refused in one line.

Each case has the report from which its input comes.
"""

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidWaypoints
from proving_ground.experiments.formats.field import FieldSettings
from proving_ground.experiments.scenario.waypoint_file import read_waypoints
from proving_ground.testbed.geodesy import MapFrame

from .samples import sentence


def points_of(folder, text, name="line.csv", **settings):
    file = folder / name
    file.write_text(text)
    return read_waypoints(file, FieldSettings(**settings))


def test_a_csv_of_libreoffice_in_french(tmp_path):
    """https://github.com/umap-project/umap/issues/1556"""
    text = "nom;lat;lon\nA;44,567;4,5\nB;44,568;4,5\n"
    points = points_of(tmp_path, text).points
    assert np.ptp(points[:, 1]) == pytest.approx(111.1, abs=0.1)


def test_numbers_of_european_excel_between_commas(tmp_path):
    """https://github.com/maxrice/excel-geocoding-tool/issues/16"""
    with pytest.raises(InvalidWaypoints, match="decimal commas"):
        points_of(tmp_path, "38,8978881835938,-77,0363311767578,High\n")


def test_the_line_that_tells_excel_the_delimiter(tmp_path):
    """https://github.com/ApamaCommunity/apama-log-analyzer/issues/5"""
    points = points_of(tmp_path, "sep=;\nx;y\n0;0\n1,5;2,5\n").points
    np.testing.assert_allclose(points, [[0.0, 0.0], [1.5, 2.5]])


def test_a_table_without_decimals_of_coordinates(tmp_path):
    """https://github.com/gbif/portal-feedback/issues/2951"""
    with pytest.raises(InvalidWaypoints, match="latitude is within 90"):
        points_of(tmp_path, "lat,lon\n-56,132\n-5612345,13298765\n")


def test_degrees_and_minutes_in_words(tmp_path):
    """https://github.com/cachly/issues-tracker/issues/5003"""
    with pytest.raises(InvalidWaypoints, match="finite number"):
        points_of(tmp_path, "lat;lon\nN51 58,123;E7 35,456\n")


def test_a_sentence_that_lost_its_middle_with_the_right_checksum(tmp_path):
    """https://github.com/SlashDevin/NeoGPS/pull/38"""
    whole = [
        sentence(f"GPGGA,2010{k:02d}.00,3249.2045{k},N,09600.00000,W,4,12,0.8,100,M,-25.6,M,,")
        for k in range(3)
    ]
    torn = "$GPGGA,201019.00,3249.20458,N,1,-25.6,M,,*6A\r\n"
    points = points_of(tmp_path, "".join([*whole, torn]), "drive.nmea").points
    assert len(points) == 3
    assert np.ptp(points) < 1.0


def test_sentences_without_a_fix(tmp_path):
    """https://github.com/stevemarple/MicroNMEA/pull/4, wellenvogel/esp32-nmea2000/issues/38"""
    text = "$GPRMC,,V,,,,,,,,,,N*53\n$GPVTG,,,,,,,,,N*30\n$GPGGA,,,,,,0,00,99.99,,,,,,*48\n"
    with pytest.raises(InvalidWaypoints, match="without a position"):
        points_of(tmp_path, text, "drive.nmea")


def test_a_sentence_after_a_prefix_of_the_modem(tmp_path):
    """https://github.com/mikalhart/TinyGPSPlus/issues/80"""
    text = (
        "+GPSRD:$GPGGA,172356.000,5051.8430,N,00510.3105,E,1,7,1.23,32.6,M,47.4,M,,*62\n"
        "$GPVTG,11.19,T,,M,0.188,N,0.348,K,A*0B\n"
    )
    waypoints = points_of(tmp_path, text, "drive.txt")
    assert waypoints.frame.origin_deg == pytest.approx((50.86405, 5.171842), abs=1e-6)
    assert waypoints.speed[0] == pytest.approx(0.348 / 3.6)


def test_a_time_that_is_none(tmp_path):
    """https://github.com/meshtastic/firmware/issues/2451"""
    text = "$GNGGA,1681483.279,4612.5634,N,00512.4790,E,0,12,0089,0231,M,0047,M,0,0000\n"
    with pytest.raises(InvalidWaypoints, match="without a position"):
        points_of(tmp_path, text, "drive.nmea")


@pytest.mark.parametrize(
    ("utm", "easting", "northing", "latitude", "longitude", "accuracy_m"),
    [
        # https://github.com/OSGeo/PROJ/issues/1076
        ("54S", 728818.37, 6086190.18, -35.3413679583, 143.517785097, 0.02),
        # https://github.com/codice/usng.js/issues/12
        ("34S", 759805.0, 7529881.0, -22.317278, 23.522050, 1.0),
    ],
)
def test_utm_of_both_hemispheres(utm, easting, northing, latitude, longitude, accuracy_m, tmp_path):
    text = f"easting,northing\n{easting},{northing}\n{easting + 1.0},{northing}\n"
    waypoints = points_of(tmp_path, text, utm=utm)
    first = waypoints.frame.degrees(waypoints.points)[0]
    offset = MapFrame((latitude, longitude)).points(*first)
    assert np.hypot(*offset) < accuracy_m


def test_a_letter_of_a_band_is_no_hemisphere():
    """https://github.com/shahid28/utm-latlng/issues/5: the zone is given as 30, "T"."""
    with pytest.raises(ValueError, match="a hemisphere N or S"):
        FieldSettings(utm="30T")


def test_an_inner_boundary_of_isoxml_is_a_ring_of_its_own(tmp_path):
    """https://github.com/AgOpenGPS-Official/AgOpenGPS/issues/1175"""
    point = '<PNT A="2" C="48.12{}" D="15.14{}"/>'
    ring = "".join(point.format(k, k) for k in range(4))
    text = (
        f'<ISO11783_TaskData><PFD A="P"><PLN A="1"><LSG A="1">{ring}</LSG>'
        f'<LSG A="2">{ring}</LSG></PLN><LSG A="5" B="AB">{ring}</LSG></PFD></ISO11783_TaskData>'
    )
    waypoints = points_of(tmp_path, text, "TASKDATA.XML")
    assert any("2 boundary rings" in note for note in waypoints.notes)
