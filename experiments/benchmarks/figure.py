"""Figures of a benchmark: value, limit, and value of the last release."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from ...testbed.recording import provenance
from ..errors import InvalidPage

RELEASED: Final = Path(__file__).with_name("released.json")


@dataclass(frozen=True, slots=True)
class Limit:
    """Largest allowed value of a figure, or the least one."""

    value: float
    least: bool = False

    def allows(self, value: float) -> bool:
        """Return whether a value is within the limit."""
        return value >= self.value if self.least else value <= self.value

    def __str__(self) -> str:
        return f"{'>=' if self.least else '<='} {self.value:g}"


@dataclass(frozen=True, slots=True)
class BenchmarkFigure:
    """One line of the table."""

    name: str
    value: float
    unit: str
    limit: Limit | None = None


Parts = Mapping[str, Sequence[BenchmarkFigure]]
"""Figures by the name of their benchmark."""


def machine() -> dict[str, str]:
    """Return processor, usable cores, system and load [processes] of this machine."""
    load = f"{os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else ""
    return {**provenance.machine(), "load": load}


def to_json(parts: Parts, where: Mapping[str, str]) -> str:
    """Return the figures with machine and versions as JSON."""
    figures = {part: [asdict(figure) for figure in own] for part, own in parts.items()}
    content = {"machine": {**where}, "versions": provenance.versions(), "parts": figures}
    return json.dumps(content, indent=1) + "\n"


def released(file: Path = RELEASED) -> tuple[dict[tuple[str, str], float], str]:
    """Return the values of the last release by part and name, and its commit.

    Raises:
        InvalidPage: the file is there and is not as `to_json` writes it.
    """
    if not file.is_file():
        return {}, "none"
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        values = {
            (part, figure["name"]): float(figure["value"])
            for part, own in content["parts"].items()
            for figure in own
        }
        return values, str(content["versions"].get("commit", "unknown"))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise InvalidPage(f"{file}: is no record of benchmarks: {error}") from None


def markdown(parts: Parts, before: Mapping[tuple[str, str], float]) -> str:
    """Return the table of all figures beside their limits and the values of the last release."""
    lines = [
        "| part | figure | value | limit | last release |",
        "|---|---|---:|---|---:|",
    ]
    for part, figures in parts.items():
        for figure in figures:
            old = before.get((part, figure.name))
            limit = str(figure.limit or "")
            if figure.limit and not figure.limit.allows(figure.value):
                limit += " **missed**"
            lines.append(
                f"| {part} | {figure.name} | {_number(figure.value)} {figure.unit} | {limit} | "
                f"{'' if old is None else _number(old)} |"
            )
    return "\n".join(lines)


def _number(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"
