"""Fault: what all kinds of `[[faults]]` have in common, and when it acts."""

from __future__ import annotations

import math
from dataclasses import dataclass as stdlib_dataclass
from typing import Annotated, Final

from pydantic import Field
from pydantic.dataclasses import dataclass

from ..configuration.config_io import STRICT, NotNegative, Positive
from ..sensing.sensor_specification import SensorSpecification
from ..vehicle.vehicle import PlantVehicle

_SAME_TIME_S: Final = 1e-9  # times closer than this are the same


@stdlib_dataclass(frozen=True, slots=True)
class Window:
    """Time in which a fault acts; its end does not belong to it."""

    start_s: float
    end_s: float  # infinite for a fault without end

    def holds(self, time_s: float) -> bool:
        """Return whether a time [s] lies in the window."""
        return self.start_s - _SAME_TIME_S <= time_s < self.end_s - _SAME_TIME_S

    def share(self, since_s: float, until_s: float) -> float:
        """Return which share of the time between two moments [s] lies in the window, 0..1."""
        overlap = min(until_s, self.end_s) - max(since_s, self.start_s)
        return min(max(overlap / (until_s - since_s), 0.0), 1.0)

    def holds_multiple(self, period_s: float) -> bool:
        """Return whether a whole multiple of a period [s] lies in the window."""
        return self.holds(period_s * math.ceil(self.start_s / period_s - _SAME_TIME_S))


@stdlib_dataclass(frozen=True, slots=True)
class FaultContext:
    """Parts of a scenario on which it depends whether a fault can act."""

    period_s: float  # control period
    sensors: SensorSpecification
    vehicle: PlantVehicle
    soil_wheels: bool  # the wheels have forces of the soil, not MuJoCo's contacts
    true_state: bool  # the controller is given the true state; there are no samples


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Fault:
    """A fault that begins once; `start_s` or `at_m` tells when.

    The keys have descriptions as values: pydantic reads no docstrings of inherited attributes.
    """

    kind: Annotated[str, Field(description="Kind of fault, see docs/faults.md.")] = ""
    name: Annotated[
        str,
        Field(
            description="Name in log, figures and `faults.NAME.key` of a sweep; absent: the kind."
        ),
    ] = ""
    start_s: Annotated[
        NotNegative | None, Field(description="Start, in seconds from the start of the run.")
    ] = None
    at_m: Annotated[
        NotNegative | None,
        Field(description="Start, as the distance of the tractor's reference along the path."),
    ] = None

    def __post_init__(self) -> None:
        if (self.start_s is None) == (self.at_m is None):
            raise ValueError("give start_s or at_m, one of the two")

    @property
    def label(self) -> str:
        """Name of the fault in log and figures."""
        return self.name or self.kind

    def refusal(self, window: Window, context: FaultContext) -> str:
        """Return why the fault cannot act in this window and scenario; empty where it can."""
        del window, context
        return ""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class LastingFault(Fault):
    """A fault that ends after some time."""

    duration_s: Annotated[
        Positive | None,
        Field(description="Time for which it lasts; absent: to the end of the run."),
    ] = None
