"""Template environment and embedded pictures of the HTML pages."""

from __future__ import annotations

import base64
from dataclasses import dataclass

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from ....testbed.configuration.resources import resource
from ...results.table import centimetres


@dataclass(frozen=True, slots=True)
class Picture:
    """A PNG picture embedded in a page."""

    name: str
    caption: str
    base64: str

    @classmethod
    def of(cls, name: str, caption: str, content: bytes) -> Picture:
        """Return the picture for the content of a PNG file."""
        return cls(name, caption, base64.b64encode(content).decode())


def environment() -> Environment:
    """Return the Jinja environment of all pages, with the filter `cm`."""
    jinja = Environment(
        loader=FileSystemLoader(
            resource("proving_ground.experiments.pictures.report", "templates")
        ),
        autoescape=True,
        undefined=StrictUndefined,
    )
    jinja.filters["cm"] = centimetres
    return jinja
