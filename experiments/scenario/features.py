"""`[[terrain.features]]`: what lies on the ground on top of its roughness."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from proving_ground.testbed.configuration.config_io import STRICT, NotNegative, Positive
from proving_ground.testbed.ground.features import Bump, Feature, Furrows, Profile, Rise, Step


@dataclass(frozen=True, config=STRICT)
class RiseSettings:
    """A slope that begins in a valley and ends in a crest."""

    kind: Literal["rise"]
    x_m: float  # where it begins
    y_m: float
    slope_rad: float  # at its steepest; negative: it falls
    length_m: Positive  # from level ground to level ground
    rounding_m: Positive = 2.0  # of valley and of crest
    uphill_deg: float = 0.0  # counter-clockwise from east

    def feature(self) -> Feature:
        """Return the feature.

        Raises:
            InvalidField: it cannot be.
        """
        uphill = math.radians(self.uphill_deg)
        return Rise(self.x_m, self.y_m, uphill, self.slope_rad, self.length_m, self.rounding_m)


@dataclass(frozen=True, config=STRICT)
class FurrowsSettings:
    """Ridges and furrows all over the field."""

    kind: Literal["furrows"]
    period_m: Positive  # from ridge to ridge
    depth_m: Positive  # from ridge to furrow
    along_deg: float = 90.0  # in which they run, counter-clockwise from east

    def feature(self) -> Feature:
        """Return the feature.

        Raises:
            InvalidField: it cannot be.
        """
        return Furrows(self.period_m, self.depth_m, math.radians(self.along_deg))


@dataclass(frozen=True, config=STRICT)
class BumpSettings:
    """A single obstacle along a line, cosine or segment of a cylinder."""

    kind: Literal["bump"]
    x_m: float  # middle
    y_m: float
    height_m: Positive
    width_m: Positive  # across the line
    length_m: NotNegative = 0.0  # of the line; 0 makes it round
    along_deg: float = 90.0  # in which the line runs, counter-clockwise from east
    profile: Profile = "cosine"

    def feature(self) -> Feature:
        """Return the feature.

        Raises:
            InvalidField: it cannot be.
        """
        along = math.radians(self.along_deg)
        return Bump(
            self.x_m, self.y_m, along, self.length_m, self.width_m, self.height_m, self.profile
        )


@dataclass(frozen=True, config=STRICT)
class DitchSettings:
    """A trench along a line, a cosine in section."""

    kind: Literal["ditch"]
    x_m: float  # middle
    y_m: float
    depth_m: Positive
    width_m: Positive  # at the top
    length_m: NotNegative = 0.0  # of the line; 0 makes a round hole
    along_deg: float = 90.0  # in which the line runs, counter-clockwise from east

    def feature(self) -> Feature:
        """Return the feature.

        Raises:
            InvalidField: it cannot be.
        """
        along = math.radians(self.along_deg)
        return Bump(self.x_m, self.y_m, along, self.length_m, self.width_m, -self.depth_m)


@dataclass(frozen=True, config=STRICT)
class StepSettings:
    """Ground that is higher beyond a line, by way of a ramp."""

    kind: Literal["step"]
    x_m: float  # where the ramp begins
    y_m: float
    height_m: float  # negative: it goes down
    ramp_m: Positive  # over which it rises
    uphill_deg: float = 0.0  # counter-clockwise from east

    def feature(self) -> Feature:
        """Return the feature.

        Raises:
            InvalidField: it cannot be.
        """
        uphill = math.radians(self.uphill_deg)
        return Step(self.x_m, self.y_m, uphill, self.height_m, self.ramp_m)


FeatureSettings = Annotated[
    RiseSettings | FurrowsSettings | BumpSettings | DitchSettings | StepSettings,
    Field(discriminator="kind"),
]
