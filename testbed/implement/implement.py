"""`[implement]`: a soil-working implement, rigid on the trailer."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Final

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, DurationS, LengthM, NotNegative, Positive
from .draft import ImplementType, Texture, draft_equation

POINTS: Final = 5  # across the width, each with its own depth and forces


@dataclass(frozen=True, config=STRICT)
class Implement:
    """A soil-working implement on the trailer, without mass: `load` is for that.

    Its default is a light field cultivator that a tractor of 750 kg pulls. `soil_force` has the
    equations. The tools are at the set depth where the vehicle stands on level ground; rough ground
    changes their depth, and so does the tilt of the trailer under the draft (a few millimetres).
    """

    type: ImplementType = "field-cultivator-second"
    """Implement in ASABE D497, see `testbed.implement.draft`."""
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
    strength_exponent: Annotated[float, Field(ge=0, le=2)] = 0.0
    """Exponent of (local cone index / background) in all forces; 0: the texture alone counts."""

    def __post_init__(self) -> None:
        usual = draft_equation(self.type).spacing_m
        if self.spacing_m is None:
            object.__setattr__(self, "spacing_m", usual)
        elif usual is None:
            raise ValueError(f"got spacing_m {self.spacing_m:g}, a {self.type} has no such key")
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
        """Return the draft [N] at the set depth on level ground (ASABE D497)."""
        a, b, c = draft_equation(self.type).coefficients(self.texture)
        return (a + b * speed_mps + c * speed_mps**2) * self.size * self.depth_m

    def notes(self) -> list[str]:
        """Return one line on the implement for the log."""
        return [
            f"implement: {self.type}, {self.width_m:g} m wide, {100.0 * self.depth_m:g} cm deep in "
            f"{self.texture} soil, {self.behind_m:g} m behind the trailer's axle; draft "
            f"{self.draft(1.0):.0f} N at 1 m/s on level ground"
        ]
