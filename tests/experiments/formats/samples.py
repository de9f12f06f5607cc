"""The same drive in the formats of other programs, and a broken sample of each."""

import json
import math
import struct
from pathlib import Path

import numpy as np
from proving_ground.testbed.geodesy import MapFrame

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
ORIGIN_DEG = (44.97, -93.26)
FRAME = MapFrame(ORIGIN_DEG)
SPEED_MPS = 1.2
POINTS = np.array([[-15.0, -2.0], [-5.0, -1.0], [5.0, 1.0], [15.0, 2.0]])  # east, north [m]
DEGREES = FRAME.degrees(POINTS)  # latitude, longitude
RING = FRAME.degrees(np.array([[-30.0, -20.0], [30.0, -20.0], [30.0, 20.0], [-30.0, -20.0]]))


def csv_degrees():
    rows = [f"{lat:.10f},{lon:.10f},{SPEED_MPS}" for lat, lon in DEGREES]
    return "\n".join(["lat,lon,speed", *rows])


def csv_german():
    rows = [f"{lat:.10f};{lon:.10f};{3.6 * SPEED_MPS}".replace(".", ",") for lat, lon in DEGREES]
    return "\n".join(["Breite;lon;speed (km/h)".replace("Breite", "Lat"), *rows])


def geojson():
    line = [[lon, lat] for lat, lon in DEGREES]
    ring = [[lon, lat] for lat, lon in RING]
    features = [
        {"type": "Feature", "properties": {"name": n}, "geometry": {"type": t, "coordinates": c}}
        for n, t, c in (("edge", "Polygon", [ring]), ("AB 1", "LineString", line))
    ]
    return json.dumps({"type": "FeatureCollection", "features": features})


def kml():
    places = " ".join(f"{lon:.10f},{lat:.10f},0" for lat, lon in DEGREES)
    return (
        '<?xml version="1.0" encoding="UTF-8"?><kml xmlns="http://www.opengis.net/kml/2.2">'
        "<Document><Placemark><name>AB 1</name><LineString><coordinates>\n"
        f"{places}</coordinates></LineString></Placemark></Document></kml>"
    )


def gpx():
    points = "".join(
        f'<trkpt lat="{lat:.10f}" lon="{lon:.10f}"><time>2026-05-01T08:00:{k:02d}Z</time></trkpt>'
        for k, (lat, lon) in enumerate(DEGREES)
    )
    return (
        '<?xml version="1.0"?><gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><name>AB 1</name><trkseg>{points}</trkseg></trk></gpx>"
    )


def taskdata():
    points = "".join(f'<PNT A="2" C="{lat:.10f}" D="{lon:.10f}"/>' for lat, lon in DEGREES)
    ring = "".join(f'<PNT A="2" C="{lat:.10f}" D="{lon:.10f}"/>' for lat, lon in RING)
    return (
        '<?xml version="1.0" encoding="UTF-8"?><ISO11783_TaskData VersionMajor="4"><PFD A="PFD1">'
        f'<PLN A="1"><LSG A="1">{ring}</LSG></PLN><GGP A="GGP1"><GPN A="GPN1"><LSG A="5" B="AB 1">'
        f"{points}</LSG></GPN></GGP></PFD></ISO11783_TaskData>"
    )


def sentence(body):
    check = 0
    for byte in body.encode():
        check ^= byte
    return f"${body}*{check:02X}\r\n"


def minutes_of(degrees, width, letters):
    whole = math.floor(abs(degrees))
    minutes = 60.0 * (abs(degrees) - whole)
    return f"{whole:0{width}d}{minutes:011.8f},{letters[0] if degrees >= 0 else letters[1]}"


def place(latitude, longitude):
    return f"{minutes_of(latitude, 2, 'NS')},{minutes_of(longitude, 3, 'EW')}"


def nmea():
    lines = []
    for k, (lat, lon) in enumerate(DEGREES):
        lines.append(sentence(f"GNGGA,0800{k:02d}.00,{place(lat, lon)},4,12,0.8,250.0,M,,M,1.0,"))
        lines.append(
            sentence(f"GNVTG,78.7,T,,M,{SPEED_MPS / 0.514444:.4f},N,{3.6 * SPEED_MPS},K,D")
        )
    return "".join(lines)


def panda():
    knots = SPEED_MPS / 0.514444
    return "".join(
        sentence(f"PANDA,0800{k:02d}.0,{place(lat, lon)},4,12,0.8,250,1.0,{knots:.4f},787,-12,0,0")
        for k, (lat, lon) in enumerate(DEGREES)
    )


def time_log(folder):
    (folder / "TLG00001.xml").write_text(
        '<?xml version="1.0"?><TIM A="" D="4"><PTN A="" B="" D=""/><DLV A="0043" B=""/></TIM>'
    )
    data = b""
    for k, (lat, lon) in enumerate(DEGREES):
        north, east = round(lat * 1e7), round(lon * 1e7)
        data += struct.pack("<IHiiBB", 28_800_000 + 1000 * k, 16_921, north, east, 4, 1)
        data += struct.pack("<Bi", 0, 17)
    (folder / "TLG00001.bin").write_bytes(data)
    return folder / "TLG00001.bin"


def agopengps(folder):
    (folder / "Field.txt").write_text(
        "2026-May-01 08:00:00 AM\r\n$FieldDir\r\nFieldNew\r\n"
        "$Offsets\r\n0,0\r\nConvergence\r\n0\r\n"
        f"StartFix\r\n{ORIGIN_DEG[0]},{ORIGIN_DEG[1]}\r\n"
    )
    points = "".join(f"{x:.3f},{y:.3f},1.4\r\n" for x, y in POINTS)
    (folder / "TrackLines.txt").write_text(
        f"$TrackLines\r\nAB 1\r\n1.4\r\n-15,-2\r\n15,2\r\n0\r\n4\r\nTrue\r\n4\r\n{points}"
    )
    (folder / "RecPath.txt").write_text("$RecPath\r\n0\r\n")
    (folder / "Boundary.txt").write_text("$Boundary\r\nFalse\r\n2\r\n-30,-20,0\r\n30,20,0\r\n")
    return folder


TEXTS = {
    "degrees.csv": csv_degrees,
    "german.csv": csv_german,
    "line.geojson": geojson,
    "line.kml": kml,
    "track.gpx": gpx,
    "TASKDATA.XML": taskdata,
    "drive.nmea": nmea,
    "panda.txt": panda,
}
"""Samples that are one text file, by its name."""

BROKEN = {
    "degrees.csv": ("lat,lon\n44.97,-93.26\n44.98\n", "line 3: got 1 columns, must be 2"),
    "german.csv": ("x,y\n1,5,2,5\n", "decimal commas"),
    "mixed.csv": ("x;y\n1,5;2.5\n", "mix decimal points and commas"),
    "line.geojson": ('{"type": "LineString", "coordinates": [[4, 91]]}', "point 0"),
    "crs.geojson": (
        '{"type": "LineString", "crs": {"properties": {"name": "EPSG:25832"}}, "coordinates": []}',
        "WGS 84",
    ),
    "line.kml": ("<kml><Placemark><LineString><coordinates>4.7", "damaged XML"),
    "bomb.kml": ('<!DOCTYPE a [<!ENTITY b "c">]><kml>&b;</kml>', "document type"),
    "track.gpx": ('<gpx><trk><trkseg><trkpt lat="north" lon="4"/></trkseg></trk></gpx>', "'north'"),
    "TASKDATA.XML": ("<ISO11783_TaskData></ISO11783_TaskData>", "without a line"),
    "drive.nmea": ("$GNGGA,080000.00,,,,,0,,,,M,,M,,*00\r\n", "without a position"),
    "RecPath.txt": ("$RecPath\r\n900\r\n1,2,0,5,True\r\n", "900 points are announced"),
    "TrackLines.txt": ("$TrackLines\r\nAB 1\r\n1.4\r\n-15,-2\r\n", "ends after line 4"),
    "other.xml": ("<settings><a/></settings>", "XML <settings>"),
    "page.csv": ("<!DOCTYPE html>\n<html><body>404</body></html>", "web page"),
    "page.geojson": ("\n<html><body>Sign in</body></html>", "web page"),
    "bare.csv": ("50.8801234,4.7001234\n50.8801235,4.7001250\n", "may be degrees"),
}
"""Texts that are refused, and a part of the message."""
