"""Interface of identifiers: from recorded driving to a vehicle with changed parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

from ..types import Command, Measurement
from ..vehicle import Vehicle

_UNITS: Final = {"s": ("time", "lag"), "m": ("wheelbase", "offset", "length")}


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
        unit = next(
            (f" {unit}" for unit, words in _UNITS.items() if any(w in self.name for w in words)), ""
        )
        return f"vehicle.{self.name} {self.before:.3g} -> {self.after:.3g} +- {self.sd:.2g}{unit}"


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


def identify_all(
    identifiers: Sequence[Identifier], window: Sequence[RecordedTick], vehicle: Vehicle
) -> Identification:
    """Return the result of all identifiers, each on the vehicle of the one before."""
    changes: list[ParameterChange] = []
    settled = True
    for identifier in identifiers:
        result = identifier.identify(window, vehicle)
        vehicle, settled = result.vehicle, settled and result.settled
        changes += result.changes
    return Identification(vehicle, tuple(changes), settled)
