"""Published figures of real machines beside this plant's, which is tuned for none of them.

`evidence.toml` has the published figures and how ours are made; `papers/evidence` measures ours.
"""

import math
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any, Final, Literal

from ttempc.errors import TtempcError

from ....testbed.errors import TestbedError
from ....testbed.validation.check import between, number
from ..evidence import field, motion, receiver, wheels
from ..machine import RIGHT, WRONG, Constant
from ..markdown import markdown
from ..runner import Runner
from ..table import Table

Kind = Literal["counted", "one-sided", "fitted", "unknown conditions"]
"""A kinder plant passes a one-sided row better. The plant is fitted to "fitted" ones; the source of
"unknown conditions" does not say what the figure depends on."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    """A figure of the plant, and the band of the published one."""

    name: str
    figure: float  # ours [unit]; NaN: none
    unit: str
    band: tuple[float, float]  # of the published figure
    published: str  # as the source states it
    rule: str  # where the band comes from
    source: str
    quote: str = ""  # of the source, verbatim
    method: str  # what was driven: scenario, settings, seeds
    kind: Kind = "counted"
    at_work: bool = False  # of a machine in a field
    why: str = "unknown"  # reason where ours is outside
    turned_out_by: tuple[str, ...] = ()  # constants that put it outside when 30 % wrong

    @property
    def verdict(self) -> str:
        """Place of our figure against the band."""
        if math.isnan(self.figure):
            return "no figure"
        low, high = self.band
        return "below" if self.figure < low else "above" if self.figure > high else "in band"

    @property
    def inside(self) -> bool:
        """Whether our figure is in the band."""
        return self.verdict == "in band"

    @property
    def can_fail(self) -> bool:
        """Whether it is outside, or a constant that is 30 % wrong puts it there."""
        return not self.inside or bool(self.turned_out_by)

    @property
    def cells(self) -> list[str]:
        """Cells of the table: figure, published, band, ours, verdict, what turns it out."""
        ours = f"{number(float(f'{self.figure:.3g}'))} {self.unit}".rstrip()
        band = between("", self.figure, *self.band, self.unit, "").expectation
        return [
            self.name + (" (at work)" if self.at_work else ""),
            self.published,
            f"{band} {self.unit}".rstrip(),
            "–" if math.isnan(self.figure) else ours,
            self.verdict if self.inside else f"**{self.verdict}**",
            ", ".join(self.turned_out_by) if self.inside else "",
        ]


@cache
def _content() -> dict[str, Any]:
    """Return the file of the published figures."""
    return tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def beside(name: str, figures: Sequence[float]) -> list[Evidence]:
    """Return the figures of an experiment, in the order of the file, beside the published ones."""
    own = _content()[name]
    about = {key: value for key, value in own.items() if key not in ("figures", "constants")}
    pairs = zip(_content()[name]["figures"], figures, strict=True)
    return [Evidence(**{**about, **row}, figure=figure) for row, figure in pairs]


Experiment = Callable[[Constant], list[float]]

EXPERIMENTS: Final[Mapping[str, Experiment]] = {
    each.__name__: each
    for each in (
        wheels.tyre_stiffness,
        wheels.combined_slip,
        wheels.efficiency,
        wheels.drawbar_power,
        wheels.second_pass,
        motion.cornering_stiffness,
        motion.ride,
        receiver.receiver_memory,
        field.work,
        field.transport_slip,
        field.slope,
        field.implement_steering,
        field.pass_to_pass,
        field.rows,
    )
}
"""By the name of their table, in the order of the page."""

Task = tuple[str, Constant]
"""Name of an experiment, and the constant that is wrong in it."""


def measure(task: Task) -> list[float]:
    """Return the figures of an experiment; NaN where nobody can build such a machine."""
    name, wrong = task
    try:
        return EXPERIMENTS[name](wrong)
    except (TestbedError, TtempcError):
        if wrong == RIGHT:
            raise
        return [math.nan] * len(_content()[name]["figures"])


def tasks(name: str) -> list[Task]:
    """Return an experiment as it is, then with each of its constants too small and too large."""
    wrong = [Constant(each, factor) for each in _content()[name]["constants"] for factor in WRONG]
    return [(name, each) for each in (RIGHT, *wrong)]


def with_power(name: str, found: Mapping[Task, Sequence[float]]) -> list[Evidence]:
    """Return the figures of an experiment, and which constants turn each out of its band."""
    items = beside(name, found[name, RIGHT])
    by_row: list[list[str]] = [[] for _ in items]
    for task in tasks(name)[1:]:
        _, wrong = task
        for turned_out, other in zip(by_row, beside(name, found[task]), strict=True):
            if not other.inside:
                turned_out.append(_signed(wrong))
    pairs = zip(items, by_row, strict=True)
    return [replace(item, turned_out_by=tuple(own)) for item, own in pairs]


def _signed(wrong: Constant) -> str:
    """Return the constant with the sign of its error."""
    _, _, name = wrong.name.partition(".")
    return f"`{name}` {'-' if wrong.factor < 1.0 else '+'}"


def _own(runner: Runner) -> list[Evidence]:
    every = [task for name in EXPERIMENTS for task in tasks(name)]
    found = dict(zip(every, runner.map(measure, every, "evidence"), strict=True))
    return [item for name in EXPERIMENTS for item in with_power(name, found)]


def constants() -> list[str]:
    """Return the names of the main constants."""
    return [f"{part}.{name}" for part, of in _content()["constants"].items() for name in of]


_GROUPS: Final[Mapping[Kind, tuple[str, str]]] = {
    "counted": ("", ""),
    "one-sided": ("a", "One-sided, not counted, a kinder plant passes better:"),
    "fitted": ("b", "Not counted: one coefficient of the plant is fitted to them:"),
    "unknown conditions": (
        "c",
        "Not counted: the source does not say what the figure depends on, and a choice of it can "
        "meet the band:",
    ),
}
"""Letter and title of the rows of each kind."""


def page(items: Sequence[Evidence]) -> str:
    """Return the page: counted rows, the other rows, how all were made."""
    heads = ["", "figure", "published", "band", "ours", "verdict", "turned out by 30 % of"]
    by_kind = {kind: [item for item in items if item.kind == kind] for kind in _GROUPS}
    parts = [_verdict(by_kind["counted"])]
    for kind, (letter, title) in _GROUPS.items():
        if own := by_kind[kind]:
            table = markdown(
                heads, [[f"{letter}{k}", *each.cells] for k, each in enumerate(own, 1)]
            )
            parts += [title, table] if title else [table]
    for head, texts in _content()["not_measured"].items():
        parts.append("\n".join([f"{head}\n", *(f"- {text}" for text in texts)]))
    for kind, (letter, _) in _GROUPS.items():
        parts += _notes(by_kind[kind], letter)
    return "\n\n".join(parts)


def _verdict(counted: Sequence[Evidence]) -> str:
    """Return how many rows are inside their bands, of all and of those that can fail."""
    able = [item for item in counted if item.can_fail]
    plant = [item for item in able if not item.at_work]
    return (
        f"{_held(counted)} figures from {len({item.source for item in counted})} sources "
        f"are inside their bands. {_held(able)} of those that can fail are inside: they are "
        f"outside, or a constant that is 30 % wrong turns them out. Of these, {_held(plant)} test "
        f"wheels, soil, body and receivers alone, the others a machine at work."
    )


def _held(items: Iterable[Evidence]) -> str:
    listed = [*items]
    return f"{sum(item.inside for item in listed)} of {len(listed)}"


def _notes(items: Sequence[Evidence], letter: str) -> list[str]:
    """Return how each run of figures with one source and method was made."""
    notes = []
    for _, run in groupby(enumerate(items, 1), lambda pair: (pair[1].source, pair[1].method)):
        group = list(run)
        first, item = group[0]
        last, _ = group[-1]
        place = f"{letter}{first}" + ("" if first == last else f" to {letter}{last}")
        quote = f' "{item.quote}".' if item.quote else ""
        lines = [f"**{place}.** {item.source.rstrip('.')}.{quote} Ours: {item.method}.", ""]
        outside = [(k, each) for k, each in group if not each.inside]
        for head, of, rows in (("Band of", "rule", group), ("Outside,", "why", outside)):
            for text, members in groupby(rows, lambda pair, of=of: getattr(pair[1], of)):
                listed = ", ".join(f"{letter}{k}" for k, _ in members)
                lines.append(f"- {head} {listed}: {text}.")
        notes.append("\n".join(lines))
    return notes


_CHECKS: Final = (("farm", "ttempc"), ("cultivate", "ttempc"), ("grass", "ttempc"))
TABLES: Final = (Table(name="evidence", make=lambda runner: page(_own(runner)), checks=_CHECKS),)
