"""Tyres: parameters, mobility numbers and normal contact, in numpy for n wheels at once.

A wheel is a disc above a Winkler bed: height look-ups under the disc give the normal force.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass as stdlib_dataclass
from typing import Annotated, Final, Self

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, NotNegative, Positive
from ..ground.terrain import Terrain
from .soil_law import SoilLaw

# The fan of look-ups: each stands for an arc of the rim, with its share of the fan. Below level
# ground the depths of an arc's points are those of its look-up +- `FAN_SPREADS`. Columns across the
# section width.
_ARC_ENDS: Final = np.radians([0.0, 4.0, 13.0, 27.0, 40.0])  # from straight down, to both sides
_MEAN_COSINES: Final = 0.5 * (np.cos(_ARC_ENDS[2:]) + np.cos(_ARC_ENDS[1:-1]))  # (3,)
_SIDE_ANGLES: Final = np.arccos(_MEAN_COSINES)
_SIDE_ARCS: Final = np.diff(_ARC_ENDS)[1:]
_SIDE_SPREADS: Final = 0.5 * (np.cos(_ARC_ENDS[1:-1]) - np.cos(_ARC_ENDS[2:]))
_LOWEST_ARC: Final = 2.0 * _ARC_ENDS[1]
_LOWEST_SPREAD: Final = 0.5 * (1.0 - np.cos(_ARC_ENDS[1]))

FAN_ANGLES: Final = np.concatenate([-_SIDE_ANGLES[::-1], [0.0], _SIDE_ANGLES])  # (7,) [rad]
FAN_ARCS: Final = np.concatenate([_SIDE_ARCS[::-1], [_LOWEST_ARC], _SIDE_ARCS]) / (
    2.0 * _ARC_ENDS[-1]
)  # (7,) sum 1
FAN_SPREADS: Final = np.concatenate(
    [_SIDE_SPREADS[::-1], [_LOWEST_SPREAD], _SIDE_SPREADS]
)  # (7,) over the radius
FAN_COLUMNS: Final = np.array([-1.0, 0.0, 1.0]) / 3.0  # (3,) of the section width

SMALLEST_LOAD: Final = 50.0  # [N] floor of the load in divisions
SMALL_SPEED: Final = 0.05  # [m/s] floor in the reported slips (the forces need none)
LEAST_UPRIGHT: Final = 0.3  # cosine of disc to vertical below which a wheel lies on its side

MOST_DEFLECTION: Final = 0.5
"""Largest deflection of a tyre at its rated load, over its section height."""

_INCH_M: Final = 0.0254

TYRE: Final = np.dtype(
    [
        ("radius", np.float64),  # [m] unloaded, also the rolling radius
        ("width", np.float64),  # [m] section width
        ("bn_area", np.float64),  # [m2] mobility number Bn where the cone index equals the load
        ("m_area", np.float64),  # [m2] mobility number M where the cone index equals the load
        ("stiffness", np.float64),  # [N/m] Winkler stiffness
        ("damping", np.float64),  # [s/m]
        ("compliance", np.float64),  # [m/N] deflection over load
    ]
)
"""Parameters of one tyre, a row of `Tyres.table`."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Tyre:
    """Numbers of one tyre, as its data sheet has them.

    The stiffness of the tyre is given by its relative deflection, or by pressure and age:

        dW/d delta = 172 - 1.77 D + 5.6 A + 0.34 b D p   [kN/m]

    with rim diameter D and width b [in], age A [years] and pressure p [bar], rolling tractor tyres
    (J. A. Lines and K. Murphy, "The stiffness of agricultural tractor tyres", J. Terramechanics 28,
    1991, from memory). The load grows with the deflection to the power of 1.5, so that the
    deflection at the rated load is 1.5 times the rated load over this stiffness.

    Raises:
        ValueError: neither deflection nor pressure is given, or the tyre of this pressure is too
            soft for its rated load.
    """

    size: str  # as printed on the tyre
    radius_m: Positive  # of the unloaded tyre
    width_m: Positive  # of the tyre's section
    section_height_m: Positive
    rated_load_n: Positive
    damping_spm: NotNegative  # growth of the normal force per speed of approach
    # at the rated load, over the section height; where a pressure is given, pressure and age count
    relative_deflection: Annotated[float, Field(gt=0, lt=MOST_DEFLECTION)] | None = None
    pressure_bar: Annotated[float, Field(gt=0, le=6)] | None = None  # of inflation
    age_years: Annotated[float, Field(ge=0, le=30)] = 0.0  # tyres stiffen; only with a pressure

    def __post_init__(self) -> None:
        if self.pressure_bar is None:
            if self.relative_deflection is None:
                raise ValueError("needs relative_deflection or pressure_bar")
            return
        deflection = self._deflection_m(self.pressure_bar) / self.section_height_m
        if not 0.0 < deflection < MOST_DEFLECTION:
            raise ValueError(
                f"got pressure_bar {self.pressure_bar:g}: the deflection at the rated load would "
                f"be {deflection:.2f} of the section height, must be below {MOST_DEFLECTION:g}"
            )
        object.__setattr__(self, "relative_deflection", deflection)

    def _deflection_m(self, pressure_bar: float) -> float:
        """Return the deflection at the rated load and a pressure [m]."""
        rim = 2.0 * (self.radius_m - self.section_height_m) / _INCH_M
        width = self.width_m / _INCH_M
        stiffness = 172.0 - 1.77 * rim + 5.6 * self.age_years + 0.34 * width * rim * pressure_bar
        return 1.5 * self.rated_load_n / (1e3 * stiffness)


@stdlib_dataclass(frozen=True, slots=True)
class Tyres:
    """Parameters of n tyres; every array is (n,)."""

    radius: FloatArray  # [m] unloaded, also the rolling radius
    width: FloatArray  # [m] section width b
    section_height: FloatArray  # [m] h
    relative_deflection: FloatArray  # delta / h at the rated load
    rated_load: FloatArray  # [N]
    damping: FloatArray  # [s/m] relative growth of the normal force per speed of approach
    radial: np.ndarray  # whether of radial plies, boolean

    @classmethod
    def of(cls, tyres: Sequence[Tyre]) -> Self:
        """Return the parameters of these tyres, in their order."""
        return cls(
            radius=np.array([tyre.radius_m for tyre in tyres]),
            width=np.array([tyre.width_m for tyre in tyres]),
            section_height=np.array([tyre.section_height_m for tyre in tyres]),
            relative_deflection=np.array([tyre.relative_deflection for tyre in tyres]),
            rated_load=np.array([tyre.rated_load_n for tyre in tyres]),
            damping=np.array([tyre.damping_spm for tyre in tyres]),
            radial=np.array([re.search(r"\dR", tyre.size) is not None for tyre in tyres]),
        )

    @property
    def stiffness(self) -> FloatArray:
        """Winkler stiffness [N/m] that gives rated load at rated deflection, (n,)."""
        deflection = self.relative_deflection * self.section_height  # (n,)
        rise = self.radius[:, None] * (1.0 - np.cos(FAN_ANGLES))  # (n, 7) over the lowest point
        spread = self.radius[:, None] * FAN_SPREADS
        depth = depth_of_arc(deflection[:, None] - rise, spread) @ FAN_ARCS  # (n,)
        return self.rated_load / depth

    def mobility_areas(self, law: SoilLaw) -> FloatArray:
        """Return the mobility numbers Bn and M for a cone index equal to the load [m^2], (n, 2)."""
        area = 2.0 * self.radius * self.width
        slenderness = 0.5 * self.width / self.radius
        bn = area * (1.0 + law.mobility_deflection * self.relative_deflection)
        m = area * np.sqrt(self.relative_deflection)
        return np.column_stack(
            [
                bn / (1.0 + law.mobility_width * slenderness),
                m / (1.0 + law.mobility_side_width * slenderness),
            ]
        )

    def table(self, law: SoilLaw) -> FloatArray:
        """Return the parameters for the compiled law, rows `TYRE`."""
        compliance = self.relative_deflection * self.section_height / self.rated_load  # [m/N]
        areas = self.mobility_areas(law)
        return np.column_stack(
            [self.radius, self.width, areas, self.stiffness, self.damping, compliance]
        )


@stdlib_dataclass(frozen=True, slots=True)
class WheelMotion:
    """Position and motion of n wheels, map frame; vectors are (n, 3)."""

    centre: FloatArray  # [m]
    axle: FloatArray  # unit vector along the axle, to the wheel's left
    velocity: FloatArray  # [m/s] of the centre
    rotation: FloatArray  # [rad/s] angular velocity of the wheel


@stdlib_dataclass(frozen=True, slots=True)
class Contact:
    """Normal contact of n wheels with the ground."""

    load: FloatArray  # (n,) [N] normal, never negative
    normal: FloatArray  # (n, 3) unit vector out of the ground
    point: FloatArray  # (n, 3) [m] centre of pressure


def mobility(
    law: SoilLaw, tyres: Tyres, load: FloatArray, cone_index: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the mobility numbers Bn (traction) and M (side force), both (n,).

    `SoilLaw` has the equations. `load` is in N, `cone_index` in kPa.
    """
    pressure = 1e3 * cone_index / np.maximum(load, SMALLEST_LOAD)  # [1/m^2]
    bn, m = tyres.mobility_areas(law).T
    return pressure * bn, pressure * m


def depth_of_arc(depth: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the mean over an arc of the depth of its points below the ground, none below 0 [m].

    With the depth d of its look-up and the spread e it is (d + e)^2 / 4 e where a part of the arc
    touches the ground, so that a tyre has a stiffness without steps.

    Args:
        depth: of the look-up [m].
        spread: by which the arc's points lie deeper or higher [m].
    """
    touching = np.clip(depth + spread, 0.0, 2.0 * spread)
    return touching**2 / (4.0 * spread) + np.maximum(0.0, depth - spread)


def contact(tyres: Tyres, terrain: Terrain, motion: WheelMotion) -> Contact:
    """Return the normal contact of a disc with a Winkler bed.

    The elastic force is minus the gradient of the energy of the bed, sum(k w E(d)) over the fan,
    with d the depth of each point below the ground and dE/dd that of its arc, `depth_of_arc`. It is
    therefore conservative on rough ground. Its direction is the normal. On level ground it grows
    with the deflection to the power of 1.5, as of a bed under a whole disc. Damping after Hunt and
    Crossley (1975) is proportional to the force, so that the load neither jumps at touch-down nor
    becomes negative.
    """
    vertical = np.array([0.0, 0.0, 1.0])
    up = vertical - motion.axle[:, 2:] * motion.axle  # (n, 3) in the disc
    upright = np.linalg.norm(up, axis=1)  # (n,)
    up = up / np.maximum(upright, LEAST_UPRIGHT)[:, None]
    ahead = np.cross(motion.axle, up)  # (n, 3)
    spoke = np.sin(FAN_ANGLES)[:, None] * ahead[:, None] - np.cos(FAN_ANGLES)[:, None] * up[:, None]
    points = (  # (n, 7, 3, 3): wheel, angle, column, xyz
        motion.centre[:, None, None]
        + tyres.radius[:, None, None, None] * spoke[:, :, None]
        + (tyres.width[:, None] * FAN_COLUMNS)[:, None, :, None] * motion.axle[:, None, None]
    )
    height, slope_x, slope_y = _surface(terrain, points[..., 0], points[..., 1])  # (n, 7, 3)
    spread = (tyres.radius[:, None] * FAN_SPREADS)[:, :, None]  # (n, 7, 1)
    depth = depth_of_arc(height - points[..., 2], spread)  # (n, 7, 3)
    depth = depth * (upright > LEAST_UPRIGHT)[:, None, None]
    pressure = depth * FAN_ARCS[:, None] / FAN_COLUMNS.size  # (n, 7, 3)
    gradient = np.stack([-slope_x, -slope_y, np.ones_like(height)], axis=-1)
    elastic = tyres.stiffness[:, None] * np.einsum("nij,nijk->nk", pressure, gradient)  # (n, 3)
    size = np.linalg.norm(elastic, axis=1)  # (n,)
    touching = size > 0.0
    normal = np.where(touching[:, None], elastic / np.where(touching, size, 1.0)[:, None], vertical)
    points[..., 2] = height
    total = np.where(touching, pressure.sum(axis=(1, 2)), 1.0)
    centre = np.einsum("nij,nijk->nk", pressure, points) / total[:, None]
    approach = -np.einsum("nk,nk->n", motion.velocity, normal)
    load = size * np.maximum(0.0, 1.0 + tyres.damping * approach)
    return Contact(load, normal, np.where(touching[:, None], centre, motion.centre))


def _surface(
    terrain: Terrain, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return height [m] and both slopes of the bilinear surface at (x, y)."""
    grid = terrain.heights
    spacing = terrain.spacing_m
    ny, nx = grid.shape
    u = np.clip((x - terrain.origin[0]) / spacing, 0.0, nx - 1.0)
    v = np.clip((y - terrain.origin[1]) / spacing, 0.0, ny - 1.0)
    i = np.minimum(u.astype(np.int64), nx - 2)
    j = np.minimum(v.astype(np.int64), ny - 2)
    p = u - i
    q = v - j
    south_west = grid[j, i]
    south_east = grid[j, i + 1]
    north_west = grid[j + 1, i]
    north_east = grid[j + 1, i + 1]
    south = south_west + p * (south_east - south_west)
    north = north_west + p * (north_east - north_west)
    slope_x = ((1.0 - q) * (south_east - south_west) + q * (north_east - north_west)) / spacing
    return south + q * (north - south), slope_x, (north - south) / spacing
