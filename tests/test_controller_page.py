"""Tables of docs/howto/controller.md: every field and entry that a controller gets, its shape."""

import re
from dataclasses import fields
from enum import IntEnum
from pathlib import Path

import pytest

from ttempc import ConstantSpeed, Vehicle, straight
from ttempc.reference.reference import Reference, ReferenceSample
from ttempc.types import Disturbance, Estimate, Input, State

PAGE = Path(__file__).parents[1] / "docs" / "howto" / "controller.md"


def rows(head):
    """Return the rest of each row of the table whose first column has this head, by name."""
    (table,) = re.findall(
        rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE.read_text(), re.MULTILINE
    )
    named = {}
    for line in table.splitlines():
        first, rest = line.removeprefix("|").split("|", 1)
        named |= dict.fromkeys(re.findall(r"`([\w.]+)`", first), rest)
    return named


def test_the_entries_of_the_vectors_are_listed():
    kinds: tuple[type[IntEnum], ...] = (State, Input, Disturbance)
    assert [*rows("entry")] == [f"{kind.__name__}.{entry.name}" for kind in kinds for entry in kind]


def test_the_fields_of_an_estimate_are_listed():
    assert rows("field of `estimate`").keys() == {item.name for item in fields(Estimate)}


@pytest.mark.parametrize("period_s", [0.2, 0.3])
def test_the_fields_of_a_reference_are_listed_with_their_shapes(period_s):
    grid = Reference(straight(10.0), Vehicle(), ConstantSpeed(1.0)).on_grid(period_s)
    assert grid.time_s[-2] < 10.0 <= grid.time_s[-1] + 1e-9
    listed = rows("field of `reference.on_grid(period_s)`")
    assert listed.keys() == {*(item.name for item in fields(ReferenceSample)), "psi_d"}
    for name, text in listed.items():
        columns = re.match(r" \(N,(?: (\d))?\) \|", text)
        assert columns, text
        assert getattr(grid, name).shape == (
            len(grid.time_s),
            *(int(number) for number in columns.groups() if number),
        )
