"""Files of strangers and ends of processes: one line, exit code 2 or 3, nothing half written."""

import io
import os
import resource
import signal
import sys
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import (
    ExperimentError,
    InvalidStudy,
    InvalidWaypoints,
    OutputExists,
)
from proving_ground.experiments.output import write_file
from proving_ground.experiments.scenario.scenario import Scenario, dump, load, read_scenario
from proving_ground.experiments.scenario.schema import json_schema
from proving_ground.experiments.scenario.waypoint_file import read_waypoints
from proving_ground.experiments.studies.sweep.study import load_study
from proving_ground.testbed.errors import InvalidField, InvalidPlant, TestbedError
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.vehicle.vehicle import read_vehicle

from ttempc.errors import InvalidPath, TtempcError
from ttempc.reference.smoothing import smooth

REFUSALS = (ExperimentError, TestbedError, TtempcError)

SETTINGS = [
    "path.laps=" + 5000 * "1",
    ".".join(3000 * "a") + "=1",
    'path={kind="file", file="a\\u0000b"}',
    'terrain.height_map="a\\u0000b"',
    f'plant.vehicle.file="{300 * "a"}.toml"',
    'terrain.height_map="/dev/zero"',
    'plant.vehicle.file="/dev/zero.toml"',
    "sensors.gnss_sd_m=1e200",
    "path.speed_mps=1e-6",
    "path={kind='straight', length_m=1e12}",
    "terrain={size_x_m=400, size_y_m=400, spacing_m=0.02}",
    "nowhere.\u001b[2J\nforged=1",
    '"\\u001b[2J\\nInjected line: all good"=1',
]


def test_bad_settings_get_one_short_line_and_leave_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    forged = 'paper"\nterrain.iso_class="A'  # an option is a value and no TOML
    for words in (
        *(["run", "--set", setting, "--out", "new"] for setting in SETTINGS),
        ["run", "--controller", forged, "--out", "new"],
        ["run", "--out", 300 * "a"],
        ["run", 300 * "a" + ".toml"],
        ["log", "info", 300 * "a" + ".mcap"],
    ):
        assert main(words) == 2
        printed = capsys.readouterr().err
        assert printed.count("\n") == 1
        assert "\x1b" not in printed
        assert len(printed) < 2100
        assert not any(tmp_path.iterdir())


def test_a_full_disk_leaves_no_file(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
        with pytest.raises(OutputExists, match=r"summary\.json: cannot be written: File too large"):
            write_file(tmp_path / "summary.json", 2000 * "a")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handler)
    assert not any(tmp_path.iterdir())


def test_a_path_is_checked_against_the_field_before_it_is_smoothed(tmp_path):
    (tmp_path / "mine.toml").write_text('[path]\nkind = "file"\nfile = "path.csv"\n')
    for text, reason in (
        ("x,y\n0,0\n100000,0\n", "point 0 of 2 at x = -50000"),
        ("x,y\n0,0\n1e308,0\n", "beyond the field"),
        ("0 0\n" * 100_002, "100002 points"),
    ):
        (tmp_path / "path.csv").write_text(text)
        with pytest.raises(REFUSALS, match=reason):
            load(str(tmp_path / "mine.toml"))[1].mission()
    with pytest.raises(InvalidPath, match="at most 40000"):
        smooth(np.array([[0.0, 0.0], [100_000.0, 0.0]]), 0.1)


def test_studies_are_limited(tmp_path):
    for key in ("seeds = 1000000000", "seeds = 1\nsamples = 1000000000"):
        (tmp_path / "study.toml").write_text(key)
        with pytest.raises(InvalidStudy, match=r"1000000|samples"):
            load_study(str(tmp_path / "study.toml"))


def test_a_pipe_as_height_map_does_not_hang(tmp_path):
    os.mkfifo(tmp_path / "pipe.npy")
    with pytest.raises(InvalidField, match="not a regular file"):
        Terrain.from_file(tmp_path / "pipe.npy", 0.1)


def test_every_number_of_the_schema_has_a_range():
    unbounded = [key for key in _unbounded("", json_schema()) if "options" not in key]
    assert unbounded == ["PlantVehicleSettings.parts"]  # checked with the vehicle file's own ranges


def _unbounded(where, node):
    """Yield the keys of numbers without a least or a largest value."""
    if isinstance(node, list):
        for item in node:
            yield from _unbounded(where, item)
    if not isinstance(node, dict):
        return
    if node.get("type") in ("number", "integer") and not (
        {"minimum", "exclusiveMinimum"} & {*node} and {"maximum", "exclusiveMaximum"} & {*node}
    ):
        yield where
    for name, table in node.get("$defs", {}).items():
        yield from _unbounded(name, table)
    for key, table in node.get("properties", {}).items():
        yield from _unbounded(f"{where}.{key}" if where else key, table)
    for word in ("anyOf", "oneOf", "items", "prefixItems", "additionalProperties"):
        yield from _unbounded(where, node.get(word))


VALUES = st.recursive(
    st.booleans()
    | st.integers(-(10**30), 10**30)
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(st.characters(blacklist_categories=("Cs",)), max_size=20),
    lambda below: st.lists(below, max_size=4) | st.dictionaries(st.text(max_size=8), below),
    max_leaves=8,
)
KEYS = st.sampled_from(sorted(Scenario.__dataclass_fields__))
QUICK = settings(max_examples=40, deadline=None, suppress_health_check=list(HealthCheck))


@QUICK
@given(KEYS, st.text(alphabet="abcdefghijklmnopqrstuvwxyz_", max_size=12), VALUES)
def test_any_value_of_a_scenario_is_refused_or_loads_to_the_same(
    tmp_path_factory, key, below, value
):
    try:
        scenario = read_scenario("grass").scenario({key: {below: value} if below else value})
    except REFUSALS:
        return
    file = tmp_path_factory.mktemp("again") / "again.toml"
    file.write_text(dump(scenario))
    assert load(str(file))[1] == scenario


@QUICK
@given(st.binary(max_size=200), st.sampled_from([".csv", ".geojson", ".toml"]))
def test_any_bytes_are_a_file_or_are_refused(tmp_path_factory, data, suffix):
    file = tmp_path_factory.mktemp("bytes") / f"a{suffix}"
    file.write_bytes(data)
    readers = {".toml": [lambda: read_vehicle(str(file)), lambda: load_study(str(file))]}
    for read in readers.get(suffix, [lambda: read_waypoints(file)]):
        with suppress(InvalidWaypoints, InvalidPlant, InvalidStudy):  # nothing else may come out
            read()


def test_an_output_without_the_letters_prints_question_marks(monkeypatch):
    raw = io.BytesIO()
    ascii_only = io.TextIOWrapper(raw, encoding="ascii")
    monkeypatch.setattr(sys, "stdout", ascii_only)
    monkeypatch.setattr(sys, "argv", ["ttempc", "list", "--help"])
    with pytest.raises(SystemExit):
        main()
    print("a\u00b7b", flush=True)
    assert raw.getvalue().endswith(b"a?b\n")
