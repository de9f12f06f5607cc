"""Plant validation and `ttempc validate`: keys, exit codes, refusals, the page."""

import json
import math
from html.parser import HTMLParser

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.pictures.report import validation_report
from proving_ground.experiments.pictures.report.validation_report import (
    ValidationReport,
    format_check,
)
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.validation.check import Check, between

KEYS = ("name", "figure", "unit", "expectation", "low", "high", "passed")
FAST = ("hydrostat", "coast-down")
COMMAND = "validate"


@pytest.fixture
def quick(monkeypatch):
    """Restrict the command to two experiments."""
    run = validation_report.validate
    monkeypatch.setattr(validation_report, "validate", lambda bench, names: run(bench, FAST))


def test_a_validation_writes_page_json_and_figures(quick, tmp_path, capsys):
    assert main([COMMAND, "grass", "--out", str(tmp_path / "new")]) == 0
    content = json.loads((tmp_path / "new" / "validation.json").read_text())
    assert list(content) == ["scenario", "passed", "versions", "checks"]
    assert (content["scenario"], content["passed"]) == ("grass", True)
    for check in content["checks"]:
        assert set(check) == {*KEYS, "source", "note"}
    text = capsys.readouterr().out
    for check in content["checks"]:
        assert f"pass  {check['name']}:" in text
    page = (tmp_path / "new" / "validation.html").read_text()
    HTMLParser().feed(page)
    assert page.count("data:image/png") == len(list((tmp_path / "new").glob("*.png"))) == 2
    assert "http" not in page.replace("http-equiv", "")


def test_a_failing_check_is_exit_code_1_and_stands_in_the_page(monkeypatch, tmp_path, capsys):
    wrong = between("gain", 2.0, 0.9, 1.1, "m/s", "the vehicle")
    monkeypatch.setattr(validation_report, "validate", lambda bench, names: iter([wrong]))
    assert main([COMMAND, "grass", "--out", str(tmp_path / "new")]) == 1
    assert "FAIL  gain: 2 m/s, expected 0.9 to 1.1 [the vehicle]" in capsys.readouterr().out
    assert "1 of 1 checks fail" in (tmp_path / "new" / "validation.html").read_text()
    assert json.loads((tmp_path / "new" / "validation.json").read_text())["passed"] is False


def test_a_check_that_does_not_apply_neither_passes_nor_fails_and_nan_fails():
    skipped = Check("slip", None, "", "", -math.inf, math.inf, "", "no slip")
    report = ValidationReport("x", {}, (skipped, between("y", 1, 0, 2, "", "s")))
    assert report.passed
    content = json.loads(report.to_json())["checks"][0]
    assert (content["passed"], content["figure"], content["low"]) == (None, None, None)
    assert format_check(skipped) == "n/a   slip: no slip"
    report = ValidationReport("x", {}, (between("y", math.nan, 0, 2, "m", "s"),))
    assert not report.passed
    content = json.loads(report.to_json())["checks"][0]
    assert [content[key] for key in KEYS] == ["y", None, "m", "at most 2", 0, 2, False]


def test_overrides_reach_the_bench():
    name, scenario = load("wet-slope", ["soil.cone_index_kpa=450"])
    bench = validation_report.bench(scenario)
    assert bench.cone_index == 450.0
    assert validation_report.validation_report(name, scenario, experiments=()).checks == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gras",), "scenario 'gras': no such scenario"),
        (("grass", "--set", "plant.timestep_s=1.0"), "plant.timestep_s"),
        (("grass", "--set", "soil.softnes=3"), "unknown key"),
        (("grass", "--out", "old"), "exists already"),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_2(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").mkdir()
    try:
        code = main([COMMAND, *arguments])
    except SystemExit as stopped:  # argparse's way out
        code = stopped.code
    printed = capsys.readouterr()
    assert code == 2
    assert message in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert not printed.out
    assert [file.name for file in tmp_path.iterdir()] == ["old"]
    assert not any((tmp_path / "old").iterdir())
