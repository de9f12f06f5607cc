"""All benchmarks, and the block of docs/performance.md that they make."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from . import closed_loop, control_step, latency, memory, start_up, sweep, tube_step
from .figure import BenchmarkFigure, Parts, machine, markdown, released, to_json

_LATENCY: Final = "latency"


def _environment() -> list[BenchmarkFigure]:
    # Imported here because gymnasium is installed only with the extra `gym`.
    from . import environment

    return environment.figures()


PARTS: Final[Mapping[str, Callable[[], list[BenchmarkFigure]]]] = {
    "control-step": control_step.figures,
    _LATENCY: latency.figures,
    "tube-step": tube_step.figures,
    "closed-loop": closed_loop.figures,
    "start-up": start_up.figures,
    "memory": memory.figures,
    "sweep": sweep.figures,
    "environment": _environment,
}
"""Benchmarks by name; each returns its figures."""

_PICTURE: Final = "performance/latency.png"  # beside the page


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


def page() -> tuple[str, dict[str, bytes]]:
    """Run all benchmarks and return the block of their page, and its picture."""
    times = latency.latencies()
    others = measure([name for name in PARTS if name != _LATENCY])
    parts = {**others.parts, _LATENCY: latency.figures(times)}
    table = Performance({name: parts[name] for name in PARTS}, others.where).table()
    alt = "Latency of a control step after 20 ms of idle, without and with preparation"
    return f"{table}\n\n![{alt}]({_PICTURE})", {_PICTURE: latency.histograms(times)}
