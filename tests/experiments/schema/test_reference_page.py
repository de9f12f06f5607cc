"""Reference of scenario keys against the scenario itself, and the command that prints it."""

import json
import re
import tomllib

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.scenario.scenario import dump, load, shipped
from proving_ground.experiments.scenario.schema import json_schema, scenario_reference

from ttempc.guidance.controllers import CONTROLLERS, controller_options


@pytest.fixture(scope="module")
def page():
    return scenario_reference()


def keys(page, header):
    """Keys of all tables with this header."""
    own = [
        part
        for part in re.split(r"^#{2,3} ", page, flags=re.MULTILINE)
        if part.startswith(f"`{header}`")
    ]
    return {key for part in own for key in re.findall(r"^\| `(\w+)` \|", part, re.MULTILINE)}


def test_each_key_of_the_schema_has_a_row(page):
    for name, table in json_schema()["$defs"].items():
        for key, value in table["properties"].items():
            text = value.get("description", "").replace("\n", " ").replace("|", "\\|")
            nested = re.search(rf"^#+ `\[+[\w.]*\b{key}\]+`", page, re.MULTILINE)
            assert nested or any(
                line.startswith(f"| `{key}` |") and line.endswith(f"{text} |")
                for line in page.splitlines()
            ), f"{name}.{key}"


@pytest.mark.parametrize("name", shipped())
def test_each_key_of_a_shipped_scenario_stands_under_its_table(page, name):
    def tables(content, path=""):
        for key, value in content.items():
            place = f"{path}.{key}" if path else key
            if isinstance(value, dict):
                yield place, False, value
                yield from tables(value, place)
            elif isinstance(value, list) and value and isinstance(value[0], dict):
                for item in value:
                    yield place, True, item

    content = tomllib.loads(dump(load(name)[1]))
    for place, many, table in tables(content):
        if place.endswith((".options", ".parts")):
            continue
        header = f"[[{place}]]" if many else f"[{place}]"
        own = {key for key, value in table.items() if not isinstance(value, dict | list)}
        assert own <= keys(page, header), header


def test_units_ranges_and_alternatives_are_told(page):
    assert "| `laps` | whole number 1 to 100 |  | `2` | Number of laps. |" in page
    assert re.search(r"\| `slope_rad` \| number 0 to 0\.6 \| rad \| `0\.0` \|", page)
    assert '`"A"`, `"B"`, `"C"`, `"D"`, `"E"`, `"F"`, `"flat"`' in page


def test_options_of_every_controller_are_listed(page):
    for name in CONTROLLERS:
        for key in controller_options(name, {}):
            assert f"| `{name}`: `{key}` |" in page


def test_the_command_writes_the_schema_once(tmp_path, capsys):
    file = tmp_path / "scenario.json"
    assert main(["list", "--schema", "-o", str(file)]) == 0
    assert json.loads(file.read_text()) == json.loads(json.dumps(json_schema()))
    assert main(["list", "--schema", "-o", str(file)]) == 2
    assert "exists already" in capsys.readouterr().err
