"""`[implement]`: a soil-working implement, rigid on the trailer, and its draft after ASABE D497.

    D = F_i (A + B S + C S^2) W T

with the draft D [N], the factor F_i of the soil's texture, the speed S [km/h], the width W [m] or
the number of tools, and the depth T [cm]. The standard gives the range of a draft in other fields,
`draft_factor`; along a field it varies by place, `draft_cv`.

Sources. The standard itself was not read. A, B and C of the subsoiler, the disk harrows and the
field cultivators, with their factors and ranges, were compared with a public transcription
(github.com/chris-hermann/tcc, parameters.py); A and B of the chisel plough with a worked example
(progressivegardening.com, "Metric Problems": 45 shanks, 15 cm, 10 km/h, factor 0.7: 68512.5 N). The
factors of the chisel plough and all numbers of the row-crop cultivator are from memory.
"""

from collections.abc import Mapping
from dataclasses import dataclass as stdlib_dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import AfterValidator, Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, DurationS, LengthM, NotNegative, Positive
from ..errors import InvalidPlant
from ..ground.soil import RandomField, RandomStrength
from ..ground.terrain import Terrain

Texture = Literal["fine", "medium", "coarse"]

_KMH_PER_MPS: Final = 3.6
_CM_PER_M: Final = 100.0


@stdlib_dataclass(frozen=True, slots=True)
class DraftEquation:
    """Parameters of one implement in the table of ASABE D497."""

    a: float  # [N/cm] per tool, or per metre of width
    b: float  # [N/cm] per km/h
    c: float  # [N/cm] per (km/h)^2
    fine: float  # factor F_1 of the standard, on clay
    medium: float  # factor F_2 of the standard, on loam
    coarse: float  # factor F_3 of the standard, on sand
    spacing_m: float | None  # usual distance between tools, assumed; None: the width counts
    vertical: float  # usual downward force over the draft, assumed

    def coefficients(self, texture: Texture) -> tuple[float, float, float]:
        """Return draft per tool (or metre) and metre of depth as a + b v + c v^2, v [m/s].

        In N/m, N s/m^2 and N s^2/m^3.
        """
        factor = _CM_PER_M * getattr(self, texture)
        return factor * self.a, factor * self.b * _KMH_PER_MPS, factor * self.c * _KMH_PER_MPS**2


# range of the draft: 50 % (chisel plough, subsoiler, disk harrow), 30 % (second pass of the disk
# harrow, field cultivator), 25 % (its second pass), 15 % (row-crop cultivator)
IMPLEMENTS: Final[Mapping[str, DraftEquation]] = MappingProxyType(
    {
        "chisel-plough": DraftEquation(91.0, 5.4, 0.0, 1.0, 0.85, 0.65, 0.30, 0.2),
        "subsoiler": DraftEquation(226.0, 0.0, 1.8, 1.0, 0.70, 0.45, 0.75, 0.2),
        "disk-harrow": DraftEquation(309.0, 16.0, 0.0, 1.0, 0.88, 0.78, None, -0.5),
        "disk-harrow-second": DraftEquation(216.0, 11.2, 0.0, 1.0, 0.88, 0.78, None, -0.5),
        "field-cultivator": DraftEquation(46.0, 2.8, 0.0, 1.0, 0.85, 0.65, 0.20, 0.2),
        "field-cultivator-second": DraftEquation(32.0, 1.9, 0.0, 1.0, 0.85, 0.65, 0.20, 0.2),
        "row-crop-cultivator": DraftEquation(140.0, 7.0, 0.0, 1.0, 0.85, 0.65, 0.75, 0.2),
    }
)
"""Implements by name; "second" is secondary tillage, the others primary tillage."""


def draft_equation(name: str) -> DraftEquation:
    """Return the draft parameters of an implement.

    Raises:
        InvalidPlant: there is no implement of that name.
    """
    if name not in IMPLEMENTS:
        allowed = ", ".join(IMPLEMENTS)
        raise InvalidPlant(f"implement.type: got {name!r}, must be one of {allowed}")
    return IMPLEMENTS[name]


def _known(name: str) -> str:
    draft_equation(name)
    return name


ImplementType = Annotated[
    str, AfterValidator(_known), Field(json_schema_extra={"enum": list(IMPLEMENTS)})
]
"""Type of a setting: the name of an implement; another name raises `InvalidPlant`."""


POINTS: Final = 5  # across the width, each with its own depth and forces


@dataclass(frozen=True, config=STRICT)
class Implement:
    """A soil-working implement on the trailer, without mass: `load` is for that.

    Its default is a light field cultivator that a tractor of 750 kg pulls. `tool_kernel` has the
    equations. The tools are at the set depth where the vehicle stands on level ground; rough ground
    changes their depth, and so does the tilt of the trailer under the draft (a few millimetres).
    """

    type: ImplementType = "field-cultivator-second"
    """Implement in ASABE D497, see `IMPLEMENTS`."""
    width_m: Annotated[float, Field(gt=0, le=20)] = 1.2
    """Working width, symmetrical about the trailer."""
    depth_m: Annotated[float, Field(gt=0, le=0.8)] = 0.05
    """Working depth on level ground."""
    texture: Texture = "medium"
    """Texture of the soil: fine (clay), medium (loam) or coarse (sand)."""
    spacing_m: LengthM | None = None
    """Distance between tools; absent: that of the type. A disk harrow has none."""
    behind_m: Annotated[float, Field(ge=0, le=10)] = 0.6
    """Distance of the tools behind the trailer's axle; assumed."""
    clearance_m: LengthM = 0.15
    """Height of the raised tools above level ground; assumed."""
    lift_s: DurationS = 2.0
    """Time to lower or raise the tools; assumed."""
    work_m: tuple[tuple[NotNegative, NotNegative], ...] = ()
    """Intervals [from, to] of the distance driven in which the tools work; empty: always."""
    # Pearson and Bevly (2007) measured 452 to 3385 N/deg on implements of a large tractor. With
    # this value that is 0.3 m2 (3 m wide, 10 cm deep) to 2.3 m2 (5 m, 45 cm): assumed.
    side_stiffness_n_per_deg_m2: NotNegative = 1500.0
    """Side force per slip angle of the tools and area (width times depth); assumed."""
    side_limit: Positive = 1.0
    """Largest side force over the draft at speed 0; assumed."""
    # Tools that are inclined forward pull themselves into the soil, disks are pushed out of it
    # (R. A. Kepner et al., "Principles of Farm Machinery", from memory; the size is assumed).
    vertical_share: Annotated[float, Field(ge=-2, le=2)] | None = None
    """Downward force of the soil on the tools over the draft; absent: that of the type, 0.2 or, of
    a disk harrow, -0.5."""
    draft_factor: Annotated[float, Field(ge=0.2, le=3)] = 1.0
    """Draft in this field over that of the standard, whose range is 0.7 to 1.3 for a field
    cultivator."""
    draft_cv: Annotated[float, Field(ge=0, le=1)] = 0.15
    """Standard deviation of the draft by place over its mean, 0.1 to 0.2 in fields; assumed."""
    draft_correlation_m: LengthM = 2.0
    """Correlation length of the draft by place; assumed."""
    strength_exponent: Annotated[float, Field(ge=0, le=2)] = 0.0
    """Exponent of (local cone index / background) in all forces; 0: the texture alone counts."""

    def __post_init__(self) -> None:
        usual = draft_equation(self.type).spacing_m
        if self.spacing_m is None:
            object.__setattr__(self, "spacing_m", usual)
        elif usual is None:
            raise ValueError(f"got spacing_m {self.spacing_m:g}, a {self.type} has no such key")
        if self.vertical_share is None:
            object.__setattr__(self, "vertical_share", draft_equation(self.type).vertical)
        ends = [end for interval in self.work_m for end in interval]
        if any(after <= before for before, after in pairwise(ends)):
            raise ValueError(
                f"got work_m {[list(each) for each in self.work_m]}, distances must increase"
            )

    @property
    def size(self) -> float:
        """W of the draft equation: number of tools, or width [m]."""
        return self.width_m / (self.spacing_m or 1.0)

    @property
    def offsets(self) -> FloatArray:
        """Places of the points across the width [m], positive to the left, (POINTS,)."""
        return self.width_m * ((np.arange(POINTS) + 0.5) / POINTS - 0.5)

    def draft(self, speed_mps: float) -> float:
        """Return the mean draft [N] at the set depth on level ground (ASABE D497)."""
        a, b, c = draft_equation(self.type).coefficients(self.texture)
        size = self.draft_factor * self.size
        return (a + b * speed_mps + c * speed_mps**2) * size * self.depth_m

    def variation(self, generator: np.random.Generator, terrain: Terrain) -> RandomField | None:
        """Return the draft by place over its mean on the points of a terrain, None without any.

        Raises:
            InvalidField: the correlation length is shorter than the terrain's spacing or longer
                than the terrain.
        """
        if self.draft_cv == 0.0:
            return None
        return RandomStrength(
            coefficient_of_variation=self.draft_cv, correlation_m=self.draft_correlation_m
        ).draw(generator, terrain)
