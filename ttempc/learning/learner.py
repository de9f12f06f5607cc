"""Interface of identifiers: from recorded driving to a vehicle with changed parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from ..types import Command, Measurement
from ..vehicle import Vehicle

LENGTHS: Final = ("wheelbase", "hitch_offset", "drawbar_length", "trailer_length")
"""Fields of `Vehicle` that are lengths [m]; all others that are identified are times [s]."""


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """What an estimator received at one control tick."""

    time_s: float
    samples: tuple[Measurement, ...]  # in the order of arrival
    command: Command | None  # of the period before; None at the first tick


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A vehicle parameter before and after an identification, SI units."""

    name: str  # field of `Vehicle`
    before: float
    after: float
    sd: float  # of the error of `after`

    def __str__(self) -> str:
        unit = "m" if self.name in LENGTHS else "s"
        return f"vehicle.{self.name} {self.before:.3g} -> {self.after:.3g} +- {self.sd:.2g} {unit}"


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of one identifier on one window."""

    vehicle: Vehicle  # the one given where nothing has changed
    changes: tuple[ParameterChange, ...] = ()  # empty where the data ask for none
    settled: bool = False  # more driving of this kind would change nothing


class Identifier(Protocol):
    """Identifies some of the parameters of a vehicle; it keeps no memory of earlier windows."""

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the parameters that the window asks for.

        A parameter changes only where the data are significant, so that a right model stays as it
        is. Called from another thread than that of the control loop.

        Args:
            window: ticks in a row, oldest first; antenna positions are those of the axle points.
            vehicle: present model parameters.
        """
        ...
