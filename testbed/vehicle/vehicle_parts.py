"""Parts of the true vehicle, with the keys of its file in `mjcf/vehicles/`.

Field names are the keys of the file and include units. x forward, y left, z up. Heights are above
level ground under unloaded tyres, except where a comment gives another reference.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field
from pydantic.dataclasses import dataclass

from ..configuration.config_io import STRICT, AngleDeg, NotNegative, PlaceM, Positive

InertiaKgm2 = tuple[Positive, Positive, Positive]


@dataclass(frozen=True, config=STRICT)
class Tractor:
    """The tractor as a whole, with axle and wheels and without trailer."""

    wheelbase_m: Positive  # L^t
    rear_track_m: Positive  # between the centres of the rear tyres
    engine_width_m: Positive  # of the body between the front wheels
    mass_kg: Positive
    centre_forward_m: PlaceM  # centre of mass ahead of the rear axle
    centre_height_m: Positive
    chassis_inertia_kgm2: InertiaKgm2 | None = None  # about x, y, z; absent: from the shapes


@dataclass(frozen=True, config=STRICT)
class FrontAxle:
    """The steered axle, which pivots in roll; its mass is without the wheels."""

    track_m: Positive  # between the centres of the front tyres, wheels straight
    kingpin_track_m: Positive  # between the kingpins
    mass_kg: Positive
    pivot_limit_deg: AngleDeg


@dataclass(frozen=True, config=STRICT)
class Wheel:
    """One of a pair of wheels; `testbed.wheels.tyre.Tyres` uses the numbers."""

    size: str  # as printed on the tyre
    radius_m: Positive  # unloaded
    width_m: Positive  # of the section
    section_height_m: Positive
    relative_deflection: Annotated[float, Field(gt=0, lt=0.5)]  # at the rated load
    rated_load_n: Positive
    damping_spm: NotNegative  # growth of the normal force per speed of approach
    mass_kg: Positive  # tyre and rim


@dataclass(frozen=True, config=STRICT)
class Hitch:
    """RJ1, the pin between tractor and drawbar."""

    offset_m: Positive  # a, behind the rear axle
    height_m: Positive
    yaw_limit_deg: Annotated[float, Field(gt=0, lt=120)]
    pitch_limit_deg: AngleDeg
    roll_limit_deg: Annotated[float, Field(gt=0, lt=180)]


@dataclass(frozen=True, config=STRICT)
class Drawbar:
    """The drawbar from RJ1 to RJ2; its centre of mass is in the middle."""

    length_m: Positive  # d
    mass_kg: Positive


@dataclass(frozen=True, config=STRICT)
class Trailer:
    """The empty trailer as a whole, with wheels and without drawbar."""

    length_m: Positive  # L^i, RJ2 to axle
    track_m: Positive
    mass_kg: Positive
    centre_forward_m: PlaceM  # centre of mass ahead of the axle
    centre_height_m: Positive
    chassis_inertia_kgm2: InertiaKgm2 | None = None  # about x, y, z; absent: from the shapes


@dataclass(frozen=True, config=STRICT)
class Box:
    """The box of the trailer, from the underside of its floor to the upper edge of its boards."""

    length_m: Positive
    width_m: Positive
    height_m: Positive
    floor_m: Positive  # underside above the ground
    forward_m: PlaceM  # middle ahead of the trailer axle


@dataclass(frozen=True, config=STRICT)
class Load:
    """Load in the box, in addition to the trailer's mass."""

    mass_kg: NotNegative
    height_m: Positive  # of the centre
    forward_m: PlaceM  # centre ahead of the trailer axle


@dataclass(frozen=True, config=STRICT)
class Steering:
    """A steering valve with its cylinder."""

    limit_deg: AngleDeg  # stop, to each side
    rate_degps: Positive
    lag_s: Positive


@dataclass(frozen=True, config=STRICT)
class Hydrostat:
    """The drive, identified by a step test on firm level ground with an empty trailer."""

    speed_gain_mps: Positive  # K, steady speed at position 1
    time_constant_s: Positive  # tau
    rate_per_s: Positive  # largest rate of the position; the controller must not exceed it
    reverse: bool = False  # positions of -1..0 drive backward, with the same K and tau


@dataclass(frozen=True, config=STRICT)
class VehicleParts:
    """All parts of a vehicle, each valid by itself."""

    description: str
    tractor: Tractor
    front_axle: FrontAxle
    front_wheel: Wheel
    rear_wheel: Wheel
    hitch: Hitch
    drawbar: Drawbar
    trailer: Trailer
    trailer_wheel: Wheel
    box: Box
    load: Load
    front_steering: Steering
    trailer_steering: Steering
    hydrostat: Hydrostat

    @property
    def wheels(self) -> dict[str, Wheel]:
        """Wheels by the name of their axle."""
        return {"front": self.front_wheel, "rear": self.rear_wheel, "trailer": self.trailer_wheel}
