"""What the project's HTML pages share: templates, filters, embedded pictures."""

from __future__ import annotations

import base64
from dataclasses import dataclass

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from proving_ground.testbed.configuration.resources import resource

from ..results.table import centimetres


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure as a page holds it."""

    name: str
    caption: str
    base64: str

    @classmethod
    def of(cls, name: str, caption: str, content: bytes) -> Picture:
        """Return the picture in a PNG file's content."""
        return cls(name, caption, base64.b64encode(content).decode())


def environment() -> Environment:
    """Return the environment in which every page is rendered."""
    made = Environment(
        loader=FileSystemLoader(resource("proving_ground.experiments.report", "templates")),
        autoescape=True,
        undefined=StrictUndefined,
    )
    made.filters["cm"] = centimetres
    return made
