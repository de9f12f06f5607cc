"""Comparison of runs: statistics and figures equal those of each run; refusals."""

import csv
import json
from dataclasses import replace

import numpy as np
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.pictures.figures.comparison_figures import COMPARISONS
from proving_ground.experiments.results.run_comparison import format_comparison, read_compared


def logs(short_runs, *names):
    return [short_runs / name / "log.mcap" for name in names]


def test_the_statistics_are_those_of_each_run(short_runs, tmp_path, capsys):
    files = logs(short_runs, "paper", "nominal")
    folder = tmp_path / "both"
    assert main(["compare", *map(str, files), "-o", str(folder)]) == 0
    printed = capsys.readouterr().out
    rows = list(csv.DictReader((folder / "comparison.csv").read_text().splitlines()))
    for file, controller in zip(files, ("paper", "ttempc-nominal"), strict=True):
        assert controller in printed
        summary = json.loads((file.parent / "summary.json").read_text())
        own = [row for row in rows if f" {controller} " in row["run"]]
        assert len(own) == 6
        for row in own:
            figures = summary["tracking"][row["where"]][row["body"]]
            for name, value in figures.items():
                assert row[name] == ("" if value is None else repr(value)), name
    assert {file.stem for file in folder.glob("*.png")} == set(COMPARISONS)


def test_runs_are_compared_up_to_the_end_of_the_shortest_and_labelled_by_what_differs(short_runs):
    runs = read_compared(logs(short_runs, "paper", "nominal"))
    assert runs[0].end_s == runs[1].end_s
    shorter, whole = replace(runs[0], end_s=9.0), runs[0].errors
    kept = whole.time_s <= 9.0
    np.testing.assert_array_equal(shorter.errors.tractor.cross_m, whole.tractor.cross_m[kept])
    assert "8 to 9.0 s" in format_comparison([shorter])
    for run in runs:
        parts = run.label.split(" · ")
        assert run.short_label == parts[1]
        assert run.common.split(" · ") == [parts[0], parts[2]]


def test_what_cannot_be_compared_is_refused_before_anything_is_written(
    short_runs, tmp_path, capsys
):
    one, other = logs(short_runs, "paper", "nominal")
    torn, folder = tmp_path / "torn.mcap", tmp_path / "both"
    torn.write_bytes(other.read_bytes()[:-5000])
    for files, words in (
        ([one, *logs(short_runs, "slower")], "different references"),
        ([one, one], "given twice"),
        ([one], "takes 2 to 6"),
        ([one, *logs(short_runs, "none")], "cannot be read"),
        ([one, torn], "is torn"),
    ):
        assert main(["compare", *map(str, files), "-o", str(folder)]) == 2
        message = capsys.readouterr().err
        assert words in message
        assert message.count("\n") == 1
        assert not folder.exists()
    assert main(["compare", str(one.parent), str(other.parent), "-o", str(folder)]) == 0
    assert (folder / "comparison.csv").exists()
