"""Single manoeuvres of the farm machine beside closed forms, and with each main constant wrong.

`closed_forms.toml` has the forms, with numbers of its own. The manoeuvres of
`testbed/validation/single_manoeuvres.py` know nothing of them.
"""

import math
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

import numpy as np

from ttempc.errors import TtempcError
from ttempc.types import FloatArray

from ....testbed.errors import TestbedError
from ....testbed.validation import single_manoeuvres as drives
from ..machine import RIGHT, WRONG, Constant, machine, turned_out
from ..markdown import markdown
from ..runner import Runner
from ..table import Block, Table
from .evidence import constants

_FILE: Final = "generated/closed-forms.md"  # path relative to the page

MANOEUVRES: Final = {
    each.__name__: each
    for each in (
        drives.standing,
        drives.climbing,
        drives.circle,
        drives.weave,
        drives.steering_step,
        drives.pull,
        drives.rolling,
        drives.tyre_test,
        drives.shaken,
        drives.tilling,
    )
}
"""By the name of their table, in the order of the page."""


def closed_forms() -> dict[str, list[float]]:
    """Return the closed forms of all figures, by manoeuvre, from the numbers of the file."""
    content = _content()
    names: dict[str, Any] = {"min": min, **vars(math)}

    def entry(value: Any) -> Any:  # noqa: ANN401 - a table or a number
        if not isinstance(value, dict):
            return value
        return SimpleNamespace(**{key: entry(inside) for key, inside in value.items()})

    names |= {key: entry(value) for key, value in content["numbers"].items()}
    for key, text in content["definitions"].items():
        names[key] = eval(text, names)
    return {name: [eval(row[2], names) for row in content[name]["rows"]] for name in MANOEUVRES}


def _content() -> dict[str, Any]:
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def measure(wrong: Constant) -> list[float]:
    """Return the figures of all manoeuvres; NaN where the machine or its drive is refused."""
    figures: list[float] = []
    for name, manoeuvre in MANOEUVRES.items():
        try:
            figures += manoeuvre(machine(wrong))
        except (TestbedError, TtempcError):
            figures += [math.nan] * len(_content()[name]["rows"])
    return figures


def wrong_constants() -> list[Constant]:
    """Return each main constant, too small and too large."""
    return [Constant(name, factor) for name in constants() for factor in WRONG]


def make(runner: Runner) -> Block:
    """Return figures beside their closed forms, and what each wrong constant turns out."""
    content = _content()
    wrong = wrong_constants()
    law = np.array([value for values in closed_forms().values() for value in values])
    rows = [row for name in MANOEUVRES for row in content[name]["rows"]]
    most = np.array([0.01 * band for _, _, _, band in rows])
    own, *others = np.array(runner.map(measure, [RIGHT, *wrong], "closed-forms"))
    inside = np.abs(own / law - 1.0) <= most

    out = {
        each: (np.flatnonzero(inside & (np.abs(found / law - 1.0) > most)) + 1).tolist()
        for each, found in zip(wrong, others, strict=True)
    }
    refused = {each for each, found in zip(wrong, others, strict=True) if np.isnan(found[0])}
    counts = np.array(
        [[len(out[each]) for each in wrong if each.name == name] for name in constants()]
    )
    most_out = (counts.max(axis=1) >= 3).sum()
    least_out = (counts.min(axis=1) >= 3).sum()
    text = (
        f"{inside.sum()} of {len(rows)} [figures]({_FILE}) are inside their bands. Of "
        f"{len(counts)} main constants, {most_out} turn three or more out when 30 % wrong "
        f"in one direction, {least_out} in either; {len(refused)} such machines are refused."
    )
    parts = (
        "# Appendix: manoeuvres beside closed forms",
        _figures(rows, law, own, inside),
        _notes(content),
        "## What could fail",
        f"{turned_out(out, refused)}\n",
    )
    return Block(text, {_FILE: "\n\n".join(parts).encode()})


def _figures(rows: list[Any], law: FloatArray, own: FloatArray, inside: FloatArray) -> str:
    """Return the table of all figures."""
    lines = [
        [
            str(number),
            name,
            f"{form:.4g} {unit}".rstrip(),
            f"± {band} %",
            f"{figure:.4g}",
            "in band" if held else "**out**",
        ]
        for number, ((name, unit, _, band), form, figure, held) in enumerate(
            zip(rows, law, own, inside, strict=True), start=1
        )
    ]
    return markdown(["", "figure", "closed form", "band", "ours", "verdict"], lines)


def _notes(content: dict[str, Any]) -> str:
    """Return the law of each manoeuvre with the numbers of its rows."""
    first = 1
    notes = []
    for name in MANOEUVRES:
        last = first + len(content[name]["rows"]) - 1
        notes.append(f"- {first} to {last}: {content[name]['of']}.")
        first = last + 1
    return "\n".join(notes)


TABLES: Final = (
    Table(name="closed-forms", make=make, checks=(("farm", "ttempc"), ("cultivate", "ttempc"))),
)
