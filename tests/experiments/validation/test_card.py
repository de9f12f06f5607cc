"""Plant validation and `ttempc validate`: keys, exit codes, refusals, the page."""

import json
from html.parser import HTMLParser

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.validation import plant_validation
from proving_ground.experiments.validation.plant_validation import (
    PlantValidation,
    format_check,
    validate_plant,
)
from proving_ground.testbed.inspection.check import between, near, not_applicable

FAST = ("hydrostat", "roughness")


@pytest.fixture
def quick(monkeypatch):
    """Restrict the command to two experiments."""
    inspect = plant_validation.inspect
    monkeypatch.setattr(plant_validation, "inspect", lambda bench, names: inspect(bench, FAST))


def test_a_validation_writes_page_json_and_figures(quick, tmp_path, capsys):
    assert main(["validate", "grass", "--out", str(tmp_path / "new")]) == 0
    content = json.loads((tmp_path / "new" / "card.json").read_text())
    assert list(content) == ["scenario", "wheels", "passed", "versions", "checks"]
    assert (content["scenario"], content["wheels"], content["passed"]) == ("grass", "soil", True)
    for check in content["checks"]:
        assert list(check) == [
            "name",
            "figure",
            "unit",
            "expectation",
            "low",
            "high",
            "source",
            "passed",
            "note",
        ]
    text = capsys.readouterr().out
    for check in content["checks"]:
        assert f"pass  {check['name']}:" in text
    page = (tmp_path / "new" / "card.html").read_text()
    HTMLParser().feed(page)
    assert page.count("data:image/png") == len(list((tmp_path / "new").glob("*.png"))) == 2
    assert "http" not in page.replace("http-equiv", "")


def test_a_failing_check_is_exit_code_1_and_stands_in_the_page(monkeypatch, tmp_path, capsys):
    wrong = near("gain", 2.0, 1.0, 0.1, "m/s", "the vehicle")
    monkeypatch.setattr(plant_validation, "inspect", lambda bench, names: iter([wrong]))
    assert main(["validate", "grass", "--out", str(tmp_path / "new")]) == 1
    assert "FAIL  gain: 2 m/s, expected 1 ± 0.1 [the vehicle]" in capsys.readouterr().out
    assert "1 of 1 checks fail" in (tmp_path / "new" / "card.html").read_text()
    assert json.loads((tmp_path / "new" / "card.json").read_text())["passed"] is False


def test_a_check_that_does_not_apply_neither_passes_nor_fails():
    card = PlantValidation(
        "x", "contact", {}, (not_applicable("slip", "no slip"), between("y", 1, 0, 2, "", "s"))
    )
    assert card.passed
    content = json.loads(card.to_json())["checks"]
    assert content[0]["passed"] is None
    assert content[0]["figure"] is None
    assert content[0]["low"] is None
    assert format_check(card.checks[0]) == "n/a   slip: no slip"


def test_a_value_that_is_nan_fails_and_is_null():
    card = PlantValidation("x", "soil", {}, (between("y", float("nan"), 0, 2, "m", "s"),))
    assert not card.passed
    assert json.loads(card.to_json())["checks"][0] | {"low": 0} == {
        "name": "y",
        "figure": None,
        "unit": "m",
        "expectation": "at most 2",
        "low": 0,
        "high": 2,
        "source": "s",
        "passed": False,
        "note": "",
    }


def test_wheels_and_overrides_reach_the_bench():
    name, scenario = load("wet-slope", ['plant.wheels="contact"', "soil.cone_index_kpa=450"])
    bench = plant_validation.bench(scenario)
    assert (bench.wheels, bench.cone_index, bench.iso_class) == ("contact", 450.0, "E")
    assert bench.slope_rad == 0.15
    assert validate_plant(name, scenario, ()).checks == ()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gras",), "scenario 'gras': no such scenario"),
        (("grass", "--set", "plant.wheels=tracks"), "plant.wheels"),
        (("grass", "--set", "soil.softnes=3"), "unknown key"),
        (("grass", "--out", "old"), "exists already"),
    ],
)
def test_bad_input_gets_one_line_and_exit_code_2(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "old").mkdir()
    try:
        code = main(["validate", *arguments])
    except SystemExit as stopped:  # argparse's way out
        code = stopped.code
    printed = capsys.readouterr()
    assert code == 2
    assert message in printed.err
    assert len(printed.err.strip().splitlines()) == 1
    assert not printed.out
    assert [file.name for file in tmp_path.iterdir()] == ["old"]
    assert not any((tmp_path / "old").iterdir())
