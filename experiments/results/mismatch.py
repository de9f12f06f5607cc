"""Table of the parameters in which plant and model differ, with what was learnt of them."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from ..scenario.mismatch import KEY_OF_FIELD

_GIVEN: Final = re.compile(r"(?P<key>\S+) (?P<model>\S+) \(true (?P<plant>\S+)\)")
_EACH: Final = re.compile(r"vehicle\.(\w+) (\S+) -> (\S+) \+- (\S+)")
NONE: Final = "none"
"""Metadata of a run whose plant and model agree."""
_HEADS: Final = ("parameter", "plant", "model", "learnt")


@dataclass(frozen=True, slots=True)
class MismatchRow:
    """One parameter, its values in the units of its key; an empty text where there is none."""

    key: str
    plant: str
    model: str
    learnt: str  # with its standard deviation, and the time at which it came to act

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Texts of a row of the table."""
        return self.key, self.plant, self.model, self.learnt


def mismatch_rows(mismatch: str, learnt: Sequence[str]) -> list[MismatchRow]:
    """Return the table of a run.

    Args:
        mismatch: the entry of that name in the metadata of a run.
        learnt: `Summary.learnt`. A parameter that was learnt is in the table also where plant and
            model agreed.
    """
    rows = {
        found["key"]: MismatchRow(found["key"], found["plant"], found["model"], "")
        for found in _GIVEN.finditer(mismatch)
    }
    for text in learnt:
        time, _, changes = text.partition(": ")
        for name, before, after, sd in _EACH.findall(changes):
            key = KEY_OF_FIELD.get(name, name)
            row = rows.get(key, MismatchRow(key, before, before, ""))
            rows[key] = MismatchRow(key, row.plant, row.model, f"{after} +- {sd} at {time}")
    return list(rows.values())


def format_mismatch(rows: Sequence[MismatchRow]) -> list[str]:
    """Return the table as lines of text, none where there is nothing to tell."""
    if not rows:
        return []
    table = [_HEADS, *(row.cells for row in rows)]
    widths = [max(len(cells[column]) for cells in table) for column in range(len(_HEADS))]
    lines = [
        "  ".join(cell.ljust(width) for cell, width in zip(cells, widths, strict=True)).rstrip()
        for cells in table
    ]
    return ["Parameters of plant and model:", *(f"  {line}" for line in lines)]
