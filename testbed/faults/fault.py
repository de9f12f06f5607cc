"""Fault: the common keys of `[[faults]]`, and the making of a kind from its row of the table."""

import math
from collections.abc import Callable
from dataclasses import dataclass as stdlib_dataclass
from typing import Annotated, Any, ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, NotNegative, Positive
from ..sensing.sensor_specification import SensorSpecification
from ..vehicle.vehicle import PlantVehicle

SAME_TIME_S: Final = 1e-9  # times closer than this are the same


@stdlib_dataclass(frozen=True, slots=True)
class Window:
    """Time in which a fault acts; its end does not belong to it."""

    start_s: float
    end_s: float  # infinite for a fault without end

    def holds(self, time_s: float) -> bool:
        """Return whether a time [s] lies in the window."""
        return self.start_s - SAME_TIME_S <= time_s < self.end_s - SAME_TIME_S

    def hold(self, times_s: FloatArray) -> NDArray[np.bool_]:
        """Return which times (n,) [s] lie in the window, (n,)."""
        return (self.start_s - SAME_TIME_S <= times_s) & (times_s < self.end_s - SAME_TIME_S)

    def share(self, since_s: float, until_s: float) -> float:
        """Return which share of the time between two moments [s] lies in the window, 0..1."""
        overlap = min(until_s, self.end_s) - max(since_s, self.start_s)
        return min(max(overlap / (until_s - since_s), 0.0), 1.0)

    def holds_multiple(self, period_s: float) -> bool:
        """Return whether a whole multiple of a period [s] lies in the window."""
        return self.holds(period_s * math.ceil(self.start_s / period_s - SAME_TIME_S))


@stdlib_dataclass(frozen=True, slots=True)
class FaultContext:
    """Parts of a scenario on which it depends whether a fault can act."""

    period_s: float  # length of a control period [s]
    sensors: SensorSpecification
    vehicle: PlantVehicle
    true_state: bool  # the controller is given the true state; there are no samples


class Key(NamedTuple):
    """A key of a fault; without a default it is required."""

    name: str
    type: Any  # type of the value, with its range
    meaning: str
    default: Any = ...


class Row(NamedTuple):
    """A row of the table of faults; `effect` and `refusal` get the fault with its keys first.

    What a fault acts on, and the arguments of `effect` after the fault:

        samples   `Sampling` -> `SampleFilter` of the samples of one sensor
        bus       state of the bus, command, time [s] -> state of the bus
        valve     set point of the step before (at first the present angle [rad], or position),
                  set point without the fault, physics step [s], stop [rad] -> set point
        plant     plant without faults -> what sets the fault for the next control period, from the
                  share of the period in which it acts
        ground    pose of the path at the place of the fault -> feature or patch of soil
    """

    kinds: str  # names with the same keys, separated by blanks
    on: Literal["samples", "bus", "valve", "plant", "ground"]
    text: str  # its effect in the docs
    keys: tuple[Key, ...]
    effect: Callable[..., Any]
    refusal: Callable[[Any, FaultContext], str] | None = None


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Fault:
    """A fault that begins once; `start_s` or `at_m` tells when.

    The keys have descriptions as values: pydantic reads no docstrings of inherited attributes.
    """

    row: ClassVar[Row]
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
    of_seeds: Annotated[
        tuple[Annotated[int, Field(ge=0, le=999)], Annotated[int, Field(ge=1, le=1000)]] | None,
        Field(description="`[k, n]`: only in runs whose seed is k modulo n; absent: in all."),
    ] = None

    def __post_init__(self) -> None:
        if (self.start_s is None) == (self.at_m is None):
            raise ValueError("give start_s or at_m, one of the two")
        if self.of_seeds and self.of_seeds[0] >= self.of_seeds[1]:
            raise ValueError(f"of_seeds [k, n]: got {[*self.of_seeds]}, k must be below n")
        if self.row.on == "ground":
            self.row.effect(self, (0.0, 0.0, 0.0))  # refuses what is too steep

    @property
    def label(self) -> str:
        """Name of the fault in log and figures."""
        return self.name or self.kind

    def in_run(self, seed: int) -> bool:
        """Return whether the run of a seed has the fault: strata of a set of seeds."""
        return self.of_seeds is None or seed % self.of_seeds[1] == self.of_seeds[0]


@dataclass(frozen=True, kw_only=True, config=STRICT)
class LastingFault(Fault):
    """A fault that ends after some time."""

    duration_s: Annotated[
        Positive | None,
        Field(description="Time for which it lasts; absent: to the end of the run."),
    ] = None


def fault_type(row: Row, module: str) -> type[Fault]:
    """Return the strict dataclass of a row; `module` is where pickle finds it, by its name."""
    kinds = row.kinds.split()
    keys = (Key("kind", Literal[tuple(kinds)], "Kind of fault.", kinds[0]), *row.keys)
    content = {
        "__module__": module,
        "__doc__": row.text,
        "__annotations__": {
            key.name: Annotated[key.type, Field(description=key.meaning)] for key in keys
        },
        **{key.name: key.default for key in keys if key.default is not ...},
        "row": row,
    }
    name = "".join(word.capitalize() for word in kinds[0].split("_")) + "Fault"
    table = type(name, (Fault if row.on == "ground" else LastingFault,), content)
    # The keys say what they mean; a search for docstrings in the source costs 3 ms a kind.
    config: Any = {**STRICT, "use_attribute_docstrings": False}
    made: Any = dataclass(frozen=True, kw_only=True, config=config)(table)
    return made
