"""`[[stages]]`: stages of a user's own in the simulation loop."""

from __future__ import annotations

from typing import Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT
from .controller import OptionValue


@dataclass(frozen=True, config=STRICT)
class StageSettings:
    """A stage in the list of `testbed/simulation/loop.py`, such as a fault or a disturbance.

    The factory is called with a random generator of the stage's own and the options; it returns a
    function of the simulation set-up and the context of the tick.
    """

    make: str
    """Factory of the stage, "package.module:factory"."""
    after: Literal["prepare", "sense", "estimate", "control", "advance"]
    """Stage after which it runs: `sense` to change samples, `control` to change commands."""
    options: dict[str, OptionValue] = Field(default_factory=dict)
    """Keyword arguments of the factory."""
