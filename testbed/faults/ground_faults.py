"""Faults of the ground: surprises that lie across the path, at a place of their own."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import Literal

from pydantic.dataclasses import dataclass

from ..configuration.config_io import STRICT, LengthM, NotNegative, PlaceM, StrengthKpa
from ..ground.features import Ditch, Feature, Step
from ..ground.soil_layers import Patch
from .fault import Fault

PathPose = tuple[float, float, float]
"""x, y [m] and heading [rad] of the path at the place of a fault."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class GroundFault(Fault):
    """A feature of the ground at the place where the reference of the tractor is at the start."""

    @abstractmethod
    def lay(self, pose: PathPose) -> Feature | Patch:
        """Return the feature or the patch of soil at a place of the path."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SoilPatch(GroundFault):
    """A round patch of soil of another strength."""

    kind: Literal["soil_patch"] = "soil_patch"
    """Kind of fault."""
    radius_m: LengthM
    """Radius."""
    cone_index_kpa: StrengthKpa
    """Cone index inside the patch."""
    left_m: PlaceM = 0.0
    """Distance of its centre to the left of the path."""

    def lay(self, pose: PathPose) -> Patch:
        """Return the patch."""
        x, y, yaw = pose
        return Patch(
            x_m=x - self.left_m * math.sin(yaw),
            y_m=y + self.left_m * math.cos(yaw),
            radius_m=self.radius_m,
            cone_index_kpa=self.cone_index_kpa,
        )


@dataclass(frozen=True, kw_only=True, config=STRICT)
class DitchAcross(GroundFault):
    """A ditch across the path."""

    kind: Literal["ditch"] = "ditch"
    """Kind of fault."""
    depth_m: LengthM
    """Depth in the middle."""
    width_m: LengthM
    """Width at the top, along the path."""
    length_m: NotNegative = 6.0
    """Length across the path; 0: a round hole."""

    def lay(self, pose: PathPose) -> Ditch:
        """Return the ditch."""
        x, y, yaw = pose
        return Ditch(
            x_m=x,
            y_m=y,
            depth_m=self.depth_m,
            width_m=self.width_m,
            length_m=self.length_m,
            along_deg=math.degrees(yaw) + 90.0,
        )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.lay((0.0, 0.0, 0.0))  # refuses what is too steep


@dataclass(frozen=True, kw_only=True, config=STRICT)
class StepAcross(GroundFault):
    """Ground that is higher behind a line across the path; the line spans the field."""

    kind: Literal["step"] = "step"
    """Kind of fault."""
    height_m: PlaceM
    """Height behind the ramp; negative for a step down."""
    ramp_m: LengthM
    """Length of the ramp."""

    def lay(self, pose: PathPose) -> Step:
        """Return the step."""
        x, y, yaw = pose
        return Step(
            x_m=x,
            y_m=y,
            height_m=self.height_m,
            ramp_m=self.ramp_m,
            uphill_deg=math.degrees(yaw),
        )

    def __post_init__(self) -> None:
        super().__post_init__()
        self.lay((0.0, 0.0, 0.0))  # refuses what is too steep
