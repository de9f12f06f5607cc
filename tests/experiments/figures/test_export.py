"""Figures for papers: widths, formats with editable text, and the data that they show."""

import csv
import io
import re

import numpy as np
import pytest
from matplotlib.figure import Figure
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.figures import FIGURES
from proving_ground.experiments.figures.export import export_figures, figure_csv, run_figures
from proving_ground.experiments.results.tracking_errors import tracking_errors
from proving_ground.experiments.sweep_report.runs import groups, read_sweep
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


def test_a_band_whose_ends_are_not_known_has_no_columns():
    axes = Figure().subplots()
    axes.fill_between([0.0, 1.0, 2.0], np.full(3, np.nan), np.ones(3), label="tube")
    axes.plot([0.0, 1.0, 2.0], [3.0, 4.0, 5.0], label="tube")
    assert figure_csv(axes.figure).splitlines()[1:] == [f"0,,tube,{x},{x + 3}" for x in (0, 1, 2)]


def data(record, name):
    """Points of a figure by chart and line."""
    points = {}
    for row in csv.DictReader(io.StringIO(figure_csv(FIGURES[name](record)))):
        points.setdefault((int(row["chart"]), row["line"]), []).append(
            (float(row["x"]), float(row["y"]))
        )
    return {key: np.array(value) for key, value in points.items()}


def test_the_csv_has_the_errors_that_the_figure_shows(record):
    errors = tracking_errors(record)
    lines = data(record, "cross-track")
    for point in ("tractor", "trailer"):
        shown = lines[0, point]
        np.testing.assert_allclose(shown[:, 1], 100 * errors.by_point[point].cross_m, rtol=1e-8)
    assert lines[0, "tractor"][-1, 0] == pytest.approx(15.0, abs=0.5)  # length of the path [m]


def test_every_line_of_the_csv_has_a_name(record):
    signals = {line for _, line in data(record, "signals")}
    assert {"feedback", "lower bound", "upper bound"} <= signals
    error = {line for _, line in data(record, "error")}
    assert error == {"tractor", "trailer", "mean on straights"}


@pytest.mark.parametrize(("width", "inches"), [("single", 8.8 / 2.54), ("12.7", 5.0)])
def test_the_width_is_that_of_the_file(log, tmp_path, width, inches):
    folder = tmp_path / "figures"
    line = ["report", str(log.parent), "-o", str(folder), "--format", "svg,png", "--width", width]
    assert main([*line, "--only", "error"]) == 0
    svg = (folder / "error.svg").read_text()
    assert float(re.search(r'width="([\d.]+)pt"', svg)[1]) == pytest.approx(72 * inches, abs=0.1)
    assert sorted(file.name for file in folder.iterdir()) == [
        "error.csv",
        "error.png",
        "error.svg",
    ]


def test_text_stays_text_and_equal_figures_give_equal_files(record):
    error = {"error": run_figures(record)["error"]}
    files = dict(export_figures(error, ["pdf", "svg"]))
    assert b">tractor error [cm]<" in files["error.svg"]
    assert b"/FontFile2" in files["error.pdf"]  # TrueType, not outlines
    assert dict(export_figures(error, ["pdf", "svg"])) == files


def test_the_csv_of_a_sweep_has_the_numbers_of_its_report(tmp_path):
    folder = swept(tmp_path, "seeds = 2", AXES)
    target = tmp_path / "figures"
    assert main(["report", str(folder), "-o", str(target), "--format", "svg"]) == 0
    sweep = read_sweep(folder)

    def rows(name):
        return list(csv.DictReader(io.StringIO((target / f"{name}.csv").read_text())))

    (_, cone) = sweep.scales
    curve = rows("error-over-cone-index-kpa")
    assert {row["line"] for row in curve} == {*sweep.controllers}
    own = groups(sweep, [cone]).set_index("controller").loc["ttempc"]
    shown = [float(row["y"]) for row in curve if row["line"] == "ttempc"]
    np.testing.assert_allclose(shown, [item.value for item in own["error_cm"]], rtol=1e-8)
    assert all(float(row["y_low"]) <= float(row["y"]) <= float(row["y_high"]) for row in curve)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--only", "all"), "--only: got 'all'"),
        (("--against", "pid"), "goes with a sweep"),
        (("--width", "3"), "from 4 to 100"),
        (("--style", "nowhere"), "is no file and no style"),
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
