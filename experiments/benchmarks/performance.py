"""All benchmarks, and the block of docs/performance.md that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from . import closed_loop, control_step, latency, memory, start_up, sweep, tube_step
from .figure import BenchmarkFigure, Parts, machine, markdown, released, to_json

PARTS: Final[Mapping[str, Callable[[], list[BenchmarkFigure]]]] = {
    "control-step": control_step.figures,
    "latency": latency.figures,
    "tube-step": tube_step.figures,
    "closed-loop": closed_loop.figures,
    "start-up": start_up.figures,
    "memory": memory.figures,
    "sweep": sweep.figures,
}
"""Benchmarks by name; each returns its figures."""

_PICTURE: Final = "performance/latency.png"


@dataclass(frozen=True, slots=True)
class Performance:
    """Figures of benchmarks and the machine that they are from."""

    parts: Parts
    where: Mapping[str, str]

    def table(self) -> str:
        """Return the machine, and the table with limits and the last release (Markdown)."""
        before, commit = released()
        where = ", ".join(f"{name} {value}" for name, value in self.where.items())
        return f"{where}; last release: {commit}\n\n{markdown(self.parts, before)}"

    def json(self) -> str:
        """Return figures, machine and versions as JSON."""
        return to_json(self.parts, self.where)


def measure(
    names: Sequence[str] = (), on_part: Callable[[str], object] = lambda part: None
) -> Performance:
    """Run benchmarks, all by default.

    Args:
        names: of `PARTS`.
        on_part: called with the name of each before it runs.
    """
    where, parts = machine(), {}
    for name in names or PARTS:
        on_part(name)
        parts[name] = PARTS[name]()
    return Performance(parts, where)
