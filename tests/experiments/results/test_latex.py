"""Tables in LaTeX: what a compiler reads is what the page says."""

import csv
import re

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.results.latex import latex_table

from tests.experiments.sweep_rows import AXES, swept

ENTRY = re.compile(r"(?<!\\)&")


def cells(table):
    """Return the rows of a `tabular` as a reader sees them in print."""
    assert table.count(r"\begin{tabular}") == table.count(r"\end{tabular}") == 1
    lines = [line[:-2] for line in table.splitlines() if line.endswith(r"\\")]
    return [[printed(cell.strip()) for cell in ENTRY.split(line)] for line in lines]


def printed(cell):
    assert not re.search(r"(?<!\\)[%#_&]", cell)
    return re.sub(r"\\([%#_&])", r"\1", cell.replace("$-$", "-"))


def test_special_characters_are_escaped_and_numbers_stand_to_the_right():
    heads = ("name_of", "share [%]", "error [cm]")
    rows = (("a & b #1", "50", "-1.5 (-2.0 to 3-4)"), ("x-3", "–", "2.0"))
    table = latex_table(heads, rows, "note")
    assert cells(table) == [list(heads), *map(list, rows)]
    assert r"{lrr}" in table
    assert "-1" not in table.replace("$-$1", "")
    assert table.splitlines()[0] == "% note"


def test_a_comparison_has_the_errors_of_its_csv(short_runs, tmp_path):
    files = [str(short_runs / name / "log.mcap") for name in ("paper", "nominal")]
    folder = tmp_path / "both"
    assert main(["compare", *files, "--latex", "-o", str(folder)]) == 0
    _, *rows = cells((folder / "comparison.tex").read_text())
    table = list(csv.DictReader((folder / "comparison.csv").read_text().splitlines()))
    whole = {(row["run"], row["body"]): row for row in table if row["where"] == "all"}
    assert len(rows) == len(whole) == 4
    for run, point, p95, *_ in rows:
        expected_cm = 100.0 * float(whole[run, point]["cross_p95_m"])
        assert float(p95) == pytest.approx(expected_cm, abs=0.06)


def test_a_run_has_no_rows_of_curves_that_its_path_lacks(short_runs, tmp_path, capsys):
    file = tmp_path / "run.tex"
    log = str(short_runs / "nominal")
    assert main(["report", log, "--latex", "-o", str(file)]) == 0
    _, *rows = cells(file.read_text())
    assert [row[:2] for row in rows] == [
        ["whole path", "trailer"],
        ["whole path", "tractor"],
        ["straight", "trailer"],
        ["straight", "tractor"],
    ]
    before = file.read_text()
    capsys.readouterr()
    for options, word in (((), str(file)), (("--format", "pdf"), "--format")):
        assert main(["report", log, "--latex", *options, "-o", str(file)]) == 2
        message = capsys.readouterr().err
        assert word in message
        assert message.count("\n") == 1
        assert file.read_text() == before


def test_a_sweep_has_the_tables_of_its_page(tmp_path):
    folder = swept(tmp_path, "seeds = 2", AXES)
    assert main(["report", str(folder), "--latex"]) == 0
    assert main(["report", str(folder)]) == 0
    page = (folder / "report" / "report.html").read_text()
    heads, *rows = cells((folder / "tables" / "controllers.tex").read_text())
    assert heads[0] == "controller"
    assert len(rows) > 1
    for row in rows:
        assert all(f">{cell}</td>" in page for cell in row)
