"""Study files: axes, seeds, samples and the logs to keep; the dimensions of a study's grid."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, ClassVar, Final, Literal

import numpy as np
import tomli_w
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ....testbed.configuration.config_io import STRICT, read_toml, validated
from ....testbed.configuration.resources import ShippedFiles
from ....testbed.randomness import generator
from ...errors import InvalidStudy
from ...scenario.scenario import without_none

_STUDIES: Final = ShippedFiles(
    "study", "proving_ground.experiments", "sweeps", ".toml", InvalidStudy
)

MOST: Final = 1_000_000
"""Largest number of seeds, samples or values of an axis."""
MOST_RUNS: Final = 10_000_000
"""Largest number of runs of a study."""

Scalar = bool | int | float | str
Change = Mapping[str, Scalar]  # dotted key -> value
Seed = Annotated[int, Field(ge=0, lt=2**32)]
Count = Annotated[int, Field(ge=1, le=MOST)]
Distribution = Literal["uniform", "log-uniform", "normal"]

BY_NAME: Final = ("scenario", "controller")
"""Axes that are no key of a scenario file."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class AxisKeys:
    """The key that an axis varies, or several keys that it varies together."""

    key: str | None = None
    keys: Annotated[tuple[str, ...], Field(min_length=1)] | None = None
    relative: bool = False  # values are factors on the value in the scenario
    optional: bool = False  # a scenario that has no such key is driven as it is

    def __post_init__(self) -> None:
        if (self.key is None) == (self.keys is None):
            raise ValueError("give key, or keys for several that move together, not both")
        if self.relative and self.optional:
            raise ValueError(f"axis {self.label}: relative and optional exclude each other")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the keys of the axis."""
        return self.keys or (self.key or "",)

    @property
    def label(self) -> str:
        """Return the name of the axis in messages."""
        return " and ".join(self.names)


@dataclass(frozen=True, kw_only=True, config=STRICT)
class ListAxis(AxisKeys):
    """A list of values."""

    kind: Literal["list"]
    values: Annotated[tuple[Scalar | tuple[Scalar, ...], ...], Field(min_length=1)]

    def __post_init__(self) -> None:
        super().__post_init__()
        for value in self.values:
            if isinstance(value, tuple) and len(value) != len(self.names):
                raise ValueError(
                    f"values of {self.label} must be single ones or lists of {len(self.names)}"
                )


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GridAxis(AxisKeys):
    """Evenly spaced values."""

    kind: Literal["grid"]
    low: float
    high: float
    count: Annotated[int, Field(ge=2, le=MOST)]
    spacing: Literal["linear", "log"] = "linear"

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_range(self.low, self.high, self.spacing == "log")


@dataclass(frozen=True, kw_only=True, config=STRICT)
class DrawnAxis(AxisKeys):
    """Random values: independent, or a Latin hypercube over all axes of that kind."""

    kind: Literal["random", "latin-hypercube"]
    low: float
    high: float
    distribution: Distribution = "uniform"

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_range(self.low, self.high, self.distribution == "log-uniform")


@dataclass(frozen=True, kw_only=True, config=STRICT)
class VariantAxis:
    """Named sets of changes, such as parts that are switched on one after the other."""

    kind: Literal["variants"]
    name: Annotated[str, Field(pattern=r"^\w+$")]  # column of the rows, which holds the labels
    values: Annotated[
        dict[str, dict[str, Any]], Field(min_length=1)
    ]  # label -> tables, as of `set`
    relative: ClassVar[bool] = False
    optional: ClassVar[bool] = False

    def __post_init__(self) -> None:
        if self.name in BY_NAME:
            raise ValueError(f"variants: their name is a column, not {self.name}")

    @property
    def names(self) -> tuple[str, ...]:
        """Return the column of the axis."""
        return (self.name,)

    @property
    def label(self) -> str:
        """Return the name of the axis in messages."""
        return self.name


def _check_range(low: float, high: float, logarithmic: bool) -> None:
    if not low < high:
        raise ValueError(f"low must be below high, got {low:g} and {high:g}")
    if logarithmic and low <= 0.0:
        raise ValueError(f"low must be above 0 on a logarithmic scale, got {low:g}")


Axis = Annotated[ListAxis | GridAxis | DrawnAxis | VariantAxis, Field(discriminator="kind")]


@dataclass(frozen=True, config=STRICT)
class Study:
    """The content of a study file; it determines the plan of a sweep."""

    description: str = ""
    scenario: str = "grass"
    seeds: (
        Annotated[int, Field(ge=1, le=MOST)] | Annotated[tuple[Seed, ...], Field(min_length=1)]
    ) = 1
    samples: Count | None = None  # of all drawn axes together
    draw: Seed = 1  # seed of the drawn values
    keep: Literal["none", "all", "failed"] = "none"  # which logs stay in the folder
    skip_refused: bool = False  # leave out what a scenario or a controller refuses
    set: dict[str, Any] = Field(default_factory=dict)
    axis: tuple[Axis, ...] = ()

    def __post_init__(self) -> None:
        drawn = any(isinstance(axis, DrawnAxis) for axis in self.axis)
        if drawn != (self.samples is not None):
            raise ValueError(
                "samples is missing: how many points to draw for the drawn axes"
                if drawn
                else "samples is given, but no axis is random or latin-hypercube"
            )
        names = [name for axis in self.axis for name in axis.names]
        for name in names:
            if name == "controller.name":
                raise ValueError('axis controller.name: its name is "controller"')
            if names.count(name) > 1:
                raise ValueError(f"two axes move {name}")
        for axis in self.axis:
            named = any(name in BY_NAME for name in axis.names)
            if named and (not isinstance(axis, ListAxis) or axis.relative):
                raise ValueError(f"axis {axis.label}: names come as a list of values")
        if isinstance(self.seeds, tuple) and len({*self.seeds}) < len(self.seeds):
            raise ValueError("seeds holds one twice")

    @property
    def point_seeds(self) -> tuple[int, ...]:
        """Return the seeds under which every point is driven."""
        return self.seeds if isinstance(self.seeds, tuple) else tuple(range(1, self.seeds + 1))

    @property
    def names(self) -> tuple[str, ...]:
        """Return all varied keys in the order of the file."""
        return tuple(name for axis in self.axis for name in axis.names)

    def dump(self) -> str:
        """Return the study as TOML, defaults included."""
        return tomli_w.dumps(without_none(asdict(self)))


def shipped_studies() -> list[str]:
    """Return the names of the studies that ship with the project."""
    return _STUDIES.names()


def load_study(name: str) -> tuple[str, Study]:
    """Return name and content of a study; paths of scenarios are made absolute.

    Args:
        name: a shipped study, or the path of a TOML file.

    Raises:
        InvalidStudy: there is no such study, or its content is invalid.
    """
    file = _STUDIES.find(name)
    content = read_toml(file, InvalidStudy)
    try:
        study = validated(Study, _anchored(content, file.parent), InvalidStudy)
    except InvalidStudy as error:
        raise InvalidStudy(f"{file}: {error}") from None
    return file.stem, study


def _anchored(content: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return the content of a file, not validated, with the paths of its scenarios absolute."""

    def anchored(value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, list):
            return [anchored(item) for item in value]
        named = isinstance(value, str) and value.endswith(".toml")
        return str((folder / value).resolve()) if named else value

    content = {**content, "scenario": anchored(content.get("scenario", "grass"))}
    axes = content.get("axis")
    for axis in axes if isinstance(axes, list) else ():
        if isinstance(axis, dict) and axis.get("key") == "scenario":
            axis["values"] = anchored(axis.get("values"))
    return content


@dataclasses.dataclass(frozen=True, slots=True)
class Dimension:
    """One factor of the grid; its entries are combined with the entries of all others."""

    entries: Sequence[Change]
    selects_controller: bool = False  # all its entries meet the same terrain and noise
    ends: frozenset[int] | None = None  # entries at the end of a drawn axis; None: none is drawn


def dimensions(study: Study) -> tuple[Dimension, ...]:
    """Return the dimensions of a study: one for each axis, one for all drawn axes together."""
    result = []
    for axis in study.axis:
        if not isinstance(axis, DrawnAxis):
            values = grid(axis) if isinstance(axis, GridAxis) else tuple(axis.values)
            changes = [_change(axis.names, value) for value in values]
            result.append(Dimension(changes, selects_controller="controller" in axis.names))
    if study.samples is not None:
        drawn = [axis for axis in study.axis if isinstance(axis, DrawnAxis)]
        points = draw(drawn, study.samples, study.draw)
        ends = frozenset(np.concatenate([points.argmin(axis=0), points.argmax(axis=0)]).tolist())
        joint = [
            {name: value for axis, value in zip(drawn, point, strict=True) for name in axis.names}
            for point in points.tolist()
        ]
        result.append(Dimension(joint, ends=ends))
    return tuple(result)


def _change(names: Sequence[str], value: Scalar | tuple[Scalar, ...]) -> Change:
    values = value if isinstance(value, tuple) else (value,) * len(names)
    return dict(zip(names, values, strict=True))


def grid(axis: GridAxis) -> tuple[float, ...]:
    """Return the values of a grid axis; its ends are exactly `low` and `high`."""
    space = np.geomspace if axis.spacing == "log" else np.linspace
    inner = space(axis.low, axis.high, axis.count)[1:-1]
    # Four digits, so that an axis shows 387.3 kPa, not 387.2983346207417 kPa.
    return (axis.low, *(float(f"{value:.4g}") for value in inner), axis.high)


def draw(axes: Sequence[DrawnAxis], samples: int, seed: int) -> FloatArray:
    """Return `samples` points of the drawn axes, (samples, len(axes)).

    Every independent axis has its own generator, so that adding an axis does not change the
    values of the others.
    """
    from scipy.stats import norm, qmc  # loads for a second, which `ttempc list` does without

    joint = [axis.label for axis in axes if axis.kind == "latin-hypercube"]
    sampler = qmc.LatinHypercube(max(1, len(joint)), rng=generator(seed, "latin-hypercube"))
    cube = sampler.random(samples)
    columns = []
    for axis in axes:
        low = axis.low
        high = axis.high
        if axis.label in joint:
            probability = cube[:, joint.index(axis.label)]
        else:
            probability = generator(seed, f"random {axis.label}").random(samples)
        if axis.distribution == "uniform":
            columns.append(low + probability * (high - low))
        elif axis.distribution == "log-uniform":
            columns.append(low * (high / low) ** probability)
        else:  # `low` and `high` are 2.5 and 97.5 %
            sd = 0.5 * (high - low) / norm.ppf(0.975)
            columns.append(norm.ppf(probability, 0.5 * (low + high), sd))
    return np.column_stack(columns)
