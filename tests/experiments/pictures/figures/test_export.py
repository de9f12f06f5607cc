"""Figures for papers: widths, and formats with editable text."""

import re

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.pictures.figures.export import export_figures, run_figures
from proving_ground.testbed.log.reader import read_log

from tests.experiments.sweep_rows import AXES, swept


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run") / "run"
    path = "path={kind='straight',length_m=15}"
    assert main(["run", "grass", "--set", path, "--out", str(folder)]) == 0
    return folder / "log.mcap"


@pytest.fixture(scope="module")
def record(log):
    return read_log(log)


@pytest.mark.parametrize(("width", "inches"), [("single", 8.8 / 2.54), ("12.7", 5.0)])
def test_the_width_is_that_of_the_file(log, tmp_path, width, inches):
    folder = tmp_path / "figures"
    line = ["report", str(log.parent), "-o", str(folder), "--format", "svg,png", "--width", width]
    assert main([*line, "--only", "error"]) == 0
    svg = (folder / "error.svg").read_text()
    assert float(re.search(r'width="([\d.]+)pt"', svg)[1]) == pytest.approx(72 * inches, abs=0.1)
    assert {file.name for file in folder.iterdir()} == {"error.png", "error.svg"}


def test_text_stays_text_and_equal_figures_give_equal_files(record):
    error = {"error": run_figures(record)["error"]}
    files = dict(export_figures(error, ["pdf", "svg"]))
    assert b">tractor error [cm]<" in files["error.svg"]
    assert b"/FontFile2" in files["error.pdf"]  # TrueType, not outlines
    assert dict(export_figures(error, ["pdf", "svg"])) == files


def test_the_charts_of_a_sweep_are_figures_of_their_own(tmp_path):
    folder, target = swept(tmp_path, "seeds = 2", AXES), tmp_path / "figures"
    line = ["report", str(folder), "-o", str(target), "--format", "svg", "--only"]
    assert main([*line, "error-over-cone-index-kpa"]) == 0
    assert [file.name for file in target.iterdir()] == ["error-over-cone-index-kpa.svg"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--only", "all"), "--only: got 'all'"),
        (("--width", "3"), "from 4 to 100"),
        (("--format", "gif"), "got 'gif', must be of pdf, svg, png"),
    ],
)
def test_bad_input_is_refused_in_one_line(arguments, words, log, tmp_path, capsys):
    line = ["report", str(log), "-o", str(tmp_path / "f"), "--format", "png", *arguments]
    assert main(line) == 2
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert not (tmp_path / "f").exists()
