"""Recordings for Rerun: read by its own program, with all that a log holds."""

import re
import subprocess
import sys

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.logs.panels import PANELS, PATH_COLOURS
from proving_ground.testbed.log.reader import read_content
from proving_ground.testbed.log.scene import motion_of

pytest.importorskip("rerun")


@pytest.fixture(scope="module")
def recording(short_runs, tmp_path_factory):
    file = tmp_path_factory.mktemp("rerun") / "run.rrd"
    assert (
        main(["log", "export", "--format", "rerun", str(short_runs / "nominal"), "-o", str(file)])
        == 0
    )
    assert list(file.parent.iterdir()) == [file]
    return file


def rerun(tmp_path, *arguments):
    """Run the program, with a home of its own for its settings; return what it prints."""
    done = subprocess.run(
        [sys.executable, "-m", "rerun", *map(str, arguments)],
        env={"HOME": str(tmp_path), "PATH": "/usr/bin:/bin"},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_rerun_reads_every_body_path_series_and_event(recording, short_runs, tmp_path):
    assert "verified without error" in rerun(tmp_path, "rrd", "verify", recording)
    printed = rerun(tmp_path, "rrd", "print", recording)
    entities = set(re.findall(r"- (/[\w/]+) -", printed))
    content = read_content(short_runs / "nominal" / "log.mcap")
    bodies = {f"/world/vehicle/{name}" for name in motion_of(content).body_names}
    series = {f"/plots/{panel.name}/{item.field}" for panel in PANELS for item in panel.series}
    assert bodies | series <= entities
    assert {f"/world{topic}" for topic in PATH_COLOURS} <= entities
    assert {"/world/ground/mesh0", "/world/vehicle/tractor/boxes", "/events"} <= entities


def test_the_blueprint_has_field_events_and_plots_on_the_time_of_the_run(recording, tmp_path):
    printed = rerun(tmp_path, "rrd", "print", "-v", recording)
    assert "Blueprint" in printed
    assert printed.count("ViewBlueprint:class_identifier") >= 8  # field, events, six plots
    assert "TimePanelBlueprint:timeline" in printed


def test_bad_output_is_refused_in_one_line_and_nothing_is_written(
    short_runs, recording, tmp_path, capsys
):
    log = str(short_runs / "nominal" / "log.mcap")
    for out, words in (
        (tmp_path / "run.txt", "must end in .rrd"),
        (tmp_path / "no" / "run.rrd", "cannot be written"),
        (recording, "exists already"),
    ):
        assert main(["log", "export", "--format", "rerun", log, "-o", str(out)]) == 2
        error = capsys.readouterr().err
        assert words in error
        assert error.count("\n") == 1
    assert not any(tmp_path.iterdir())


def test_without_its_extra_it_is_refused_with_its_name(short_runs, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    log = str(short_runs / "nominal" / "log.mcap")
    assert main(["log", "export", "--format", "rerun", log, "-o", str(tmp_path / "run.rrd")]) == 2
    assert "pip install 'ttempc-proving-ground[rerun]'" in capsys.readouterr().err
