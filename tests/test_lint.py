"""Each rule of `packaging/lint.py` refuses a sample and passes its better form."""

from pathlib import Path

import pytest

import lint
import readable
from readable import Module

ROOT = Path(__file__).parents[1]


def found(rule: readable.Rule, *lines: str) -> list[int]:
    """Return the lines at which a rule finds faults."""
    return [fault.line for fault in rule(Module.of("sample.py", "\n".join(lines)))]


@pytest.mark.parametrize(
    "packed",
    [
        "a, b = c, d",
        "x, y = 0.0, 0.0",
        "self.begin, self.count = self.begin + 1, self.count - 1",
        "[a, b] = [c, d]",
        "first = a, b = c, d",
        "a, *b = c, *d",
        "x, y = left[0], right[0]",
    ],
)
def test_values_of_several_names_are_assigned_one_by_one(packed: str) -> None:
    assert found(readable.packed_assignments, packed) == [1]


@pytest.mark.parametrize(
    "good",
    [
        "x, y = point",
        "a, b = b, a",
        "x, y = point[0], point[1]",
        "a = b = 0.0",
        "LIMITS = 1.0, 2.0",
    ],
)
def test_a_vector_a_swap_and_one_value_may_be_unpacked(good: str) -> None:
    assert found(readable.packed_assignments, good) == []


def test_a_constant_is_not_read_by_position() -> None:
    rule = readable.unnamed_members({"SHARED": 3})
    assert found(rule, "_PASSED: Final = 2.0, 8.0, 900.0", "limit = _PASSED[2]") == [2]
    assert found(rule, "_PASSED = [2.0, 8.0, 900.0]", "raised, most, fade_s = _PASSED") == [2]
    assert found(rule, "limit = tables.SHARED[0]") == [1]
    assert found(rule, "class Check:", "    BAND = 1.0, 2.0", "    low = BAND[0]") == [3]


def test_a_constant_may_be_looped_over_searched_and_unpacked_as_a_range() -> None:
    rule = readable.unnamed_members({})
    names = "NAMES = 'grass', 'farm', 'rows'"
    assert found(rule, names, "known = name in NAMES", "for each in NAMES: print(each)") == []
    assert found(rule, names, "last = NAMES[-1]", "some = NAMES[index]") == []
    assert found(rule, "SPEEDS = 0.5, 3.0", "low, high = SPEEDS") == []
    assert found(rule, "row = [1.0, 2.0]", "first = row[0]") == []


def function(lines: int) -> list[str]:
    """Return a function of so many lines."""
    return ["def wait():", *["    pass"] * (lines - 1)]


def test_a_function_fits_a_screen() -> None:
    assert found(readable.long_functions, *function(80)) == []
    assert found(readable.long_functions, *function(81)) == [1]
    assert found(readable.long_functions, "class Plant:", *(f"  {x}" for x in function(81))) == [2]


def test_a_function_takes_at_most_eight_arguments() -> None:
    rule = readable.wide_functions
    assert found(rule, "def press(a, b, c, d, e, f, g, h): ...") == []
    assert found(rule, "def press(a, b, c, d, e, f, g, h, i): ...") == [1]
    assert found(rule, "def press(a, b, c, d, e, f, g, *, h, i): ...") == [1]
    assert found(rule, "def __init__(self, *, a, b, c, d, e, f, g, h, i): ...") == []
    assert found(rule, "def __init__(self, a, b, c, d, e, f, g, h): ...") == [1]


def test_columns_of_compiled_code_have_names() -> None:
    rule = readable.literal_columns
    compiled = "from numba import njit"
    assert found(rule, compiled, "law[wheel, 13]", "row[3]", "row[-4]", "row[COUNT]") == [2, 3]
    assert found(rule, compiled, "point[0] + point[1] + point[2]") == []
    assert found(rule, "law[wheel, 13]") == []


def test_what_a_text_mentions_exists() -> None:
    rule = readable.stale_references(ROOT, {"layout", "TICK"})
    assert found(rule, "# see docs/gone.md") == [1]
    assert found(rule, "# see docs/method.md and docs/examples/NAME.py") == []
    assert found(rule, "# the record `GONE_AWAY` of `layout`") == [1]
    assert found(rule, "# the record `layout.TICK` and its `x`") == []
    assert found(rule, "text = 'see packaging/gone.py'") == [1]


def test_names_are_known_from_definitions_uses_strings_and_paths() -> None:
    text = "import numpy.linalg\ndef drive(way_m): return record.stop(key='trailer_m')"
    names = readable.known_names([Module.of("testbed/plant.py", text)])
    assert {"linalg", "drive", "way_m", "record", "stop", "trailer_m", "plant"} <= names
    assert "record.stop" not in names


def test_an_allowance_is_met_exactly() -> None:
    faults = [readable.Fault("ttempc/a.py", line, "packed") for line in (3, 7)]
    assert list(lint.beyond_allowance(faults, {"ttempc/a.py": 2})) == []
    above = list(lint.beyond_allowance(faults, {"ttempc/a.py": 1}))
    assert [line.split(":")[1] for line in above] == ["3", "7"]
    (below,) = lint.beyond_allowance(faults, {"ttempc/a.py": 3})
    assert "ttempc/a.py is allowed 3 and has 2" in below


def test_shrinking_lowers_allowances_and_raises_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ttempc").mkdir()
    (tmp_path / "ttempc" / "a.py").write_text("a, b = c, d\n")
    (tmp_path / "ttempc" / "b.py").write_text("a, b = c, d\ne, f = g, h\n")
    (tmp_path / "README.md").write_text("")
    (tmp_path / "CONTRIBUTING.md").write_text("")
    project = tmp_path / "pyproject.toml"
    head = '[tool.lint]\nforeign = ["mjData"]\n\n'
    marker = "# Allowances of `packaging/lint.py`: they may only shrink.\n"
    table = '[tool.lint.packed]\n"ttempc/a.py" = 5\n"ttempc/b.py" = 1\n"ttempc/gone.py" = 2\n'
    project.write_text(f"{head}{marker}\n{table}")
    monkeypatch.setattr(lint, "ROOT", tmp_path)
    lint.shrink()
    shrunk = '[tool.lint.packed]\n"ttempc/a.py" = 1\n"ttempc/b.py" = 1\n'
    assert project.read_text() == f"{head}{marker}\n{shrunk}"


def test_clauses_are_no_titles_and_layers_hold(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "ttempc").mkdir()
    monkeypatch.setattr(lint, "ROOT", tmp_path)
    (tmp_path / "ttempc" / "clause.py").write_text('"""What a plan is."""\nimport mujoco\n')
    assert [text.split(":")[0] for text in lint.title_faults()] == ["ttempc/clause.py"]
    assert [text.split()[-1] for text in lint.layer_faults()] == ["mujoco"]
    (tmp_path / "ttempc" / "clause.py").write_text('"""Plans."""\nimport numpy\n')
    assert [*lint.title_faults(), *lint.layer_faults()] == []
