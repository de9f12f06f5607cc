"""`tube.json`: design of a tube and the data of its fit."""

from __future__ import annotations

import json
from dataclasses import asdict, fields
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.errors import TtempcError
from ttempc.tube.reference_tube import AncillaryWeights, TubeDesign
from ttempc.tube.sets import DisturbanceSet, Shape
from ttempc.types import State
from ttempc.vehicle import OUTSIDE_TUBES, Vehicle

from ...testbed.configuration.config_io import STRICT, validated
from ...testbed.configuration.resources import ShippedFiles
from ...testbed.foreign_files import json_table, read_bounded
from ..errors import InvalidFit
from .path import AnyPath

_TUBES: Final = ShippedFiles("tube", "proving_ground.experiments", "fitted", ".json", InvalidFit)
_DIMENSION: Final = len(State)
_Row = Annotated[list[float], Field(min_length=_DIMENSION, max_length=_DIMENSION)]
_Matrix = Annotated[list[_Row], Field(min_length=_DIMENSION, max_length=_DIMENSION)]
_Fraction = Annotated[float, Field(gt=0, lt=1)]
_Count = Annotated[int, Field(ge=0)]
_Width = Annotated[float, Field(gt=0)]


@dataclass(frozen=True, config=STRICT)
class SetTable:
    """A `DisturbanceSet`; rows in the order of `State`."""

    axes: _Matrix
    window: Annotated[int, Field(ge=1)]
    shape: Shape

    @classmethod
    def of(cls, item: DisturbanceSet) -> SetTable:
        """Return the table of a set."""
        return cls(item.axes.tolist(), item.window, item.shape)

    def set(self) -> DisturbanceSet:
        """Return the set."""
        return DisturbanceSet(np.array(self.axes), self.window, self.shape)


@dataclass(frozen=True, config=STRICT)
class HoldOut:
    """Windows of held-out runs inside the fitted set, with the interval of their share.

    The interval is that of Clopper and Pearson for independent windows. Windows of one run are
    not: it is too narrow.
    """

    windows: _Count
    inside: _Count
    low: float
    high: float


@dataclass(frozen=True, config=STRICT)
class Provenance:
    """Runs of the fit, and coverage of held-out runs."""

    scenarios: list[str]
    controllers: list[str]
    fitted_seeds: list[int]
    held_out_seeds: list[int]
    reference: dict[str, str]  # path and speed as in the scenarios
    coverage: _Fraction  # share of windows, for disturbance and estimate error each
    confidence: _Fraction
    disturbance: HoldOut
    estimate_error: HoldOut
    versions: dict[str, str]


@dataclass(frozen=True, config=STRICT)
class PointHalfWidths:
    """Half widths of the true positions of both axle points about the nominal ones [m]."""

    tractor_along_m: _Width
    tractor_across_m: _Width
    trailer_along_m: _Width
    trailer_across_m: _Width


@dataclass(frozen=True, config=STRICT)
class RunCalibration:
    """Half widths that the next run keeps as a whole with a given probability, and their premise.

    The premise: the next run is of the same scenario with a seed of its own. See
    `ttempc.tube.conformal`; the first 8 s of a run do not count.
    """

    scenario: str
    controller: str
    reference: dict[str, str]  # path and speed as in the scenario
    coverage: _Fraction  # required
    guaranteed: _Fraction  # k / (n + 1) of n scored runs
    scored_seeds: list[int]
    scale_seeds: list[int]
    half_widths: PointHalfWidths
    versions: dict[str, str]


@dataclass(frozen=True, config=STRICT)
class TubeFile:
    """The content of a `tube.json`."""

    format: Literal[1]
    about: str
    vehicle: dict[str, float | bool]
    period_s: Annotated[float, Field(gt=0)]
    disturbance: SetTable
    estimate_error: SetTable
    weights: AncillaryWeights
    provenance: Provenance
    calibration: RunCalibration | None = None

    def design(self) -> TubeDesign:
        """Return the design of the tube."""
        return TubeDesign(
            vehicle=Vehicle(**self.vehicle),  # pyright: ignore[reportArgumentType] - checked when read
            period_s=self.period_s,
            disturbance=self.disturbance.set(),
            estimate_error=self.estimate_error.set(),
            weights=self.weights,
        )


def tube_file(design: TubeDesign, about: str, provenance: Provenance) -> TubeFile:
    """Return the file of a design."""
    return TubeFile(
        format=1,
        about=about,
        vehicle=asdict(design.vehicle),
        period_s=design.period_s,
        disturbance=SetTable.of(design.disturbance),
        estimate_error=SetTable.of(design.estimate_error),
        weights=design.weights,
        provenance=provenance,
    )


def path_table(path: AnyPath) -> dict[str, str]:
    """Return path and speed of a scenario as text."""
    return {name: str(value) for name, value in sorted(asdict(path).items())}


def shipped_tubes() -> list[str]:
    """Return the names of the tubes that ship with the project."""
    return _TUBES.names()


def read_tube(name: str) -> TubeFile:
    """Return the content of a tube file, given a shipped name or the path of a JSON file.

    Raises:
        InvalidFit: there is no such file, or a key or a value is not allowed.
    """
    file = _TUBES.find(name)
    try:
        content = json_table(read_bounded(file))
    except OSError as error:
        raise InvalidFit(f"{file}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise InvalidFit(f"{file}: {error}") from None
    try:
        tube = validated(TubeFile, content, InvalidFit)
        required = {item.name for item in fields(Vehicle)}
        if differing := (required ^ set(tube.vehicle)) - OUTSIDE_TUBES:
            named = ", ".join(sorted(differing))
            raise InvalidFit(f"vehicle: keys that are missing or unknown: {named}")
        tube.design()
    except (InvalidFit, TtempcError) as error:
        raise InvalidFit(f"{file}: {error}") from None
    return tube


def to_json(tube: TubeFile) -> str:
    """Return the text of a tube file."""
    return json.dumps(asdict(tube), indent=1, allow_nan=False) + "\n"
