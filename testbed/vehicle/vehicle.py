"""True vehicle, a tractor with a steerable trailer: its file, its parts, axle loads and checks.

Field names are the keys of the file in `mjcf/vehicles/` and include units. x forward, y left, z up.
Heights are above level ground under unloaded tyres, except where a comment gives another reference.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass as stdlib_dataclass
from operator import attrgetter
from typing import Annotated, Final

import numpy as np
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.types import FloatArray

from ..configuration.config_io import (
    STRICT,
    AngleDeg,
    NotNegative,
    PlaceM,
    Positive,
    parse_toml,
    toml_text,
    validated,
)
from ..configuration.resources import ShippedFiles
from ..errors import InvalidPlant
from ..foreign_files import read_bounded
from ..wheels.tyre import Tyre

DEFAULT_VEHICLE: Final = "kayacan2016"
VEHICLES: Final = ShippedFiles("vehicle", "proving_ground.mjcf", "vehicles", ".toml", InvalidPlant)
"""Vehicles that ship with the project."""

_UNDERSTOOD: Final = 16  # texts of vehicles, see `_vehicle`
GRAVITY: Final = 9.81  # [m/s^2] as in MuJoCo
_LEAST_SHARE: Final = 0.05  # of the tractor's weight on each axle; it must steer and drive
_WIDEST_KNUCKLE_DEG: Final = 65.0  # beyond it the quartic of MuJoCo's coupling does not fit

Compliance = Annotated[float, Field(ge=0.0, le=0.1)]
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
    # Of the controller's model alone: side slip of the rear axle by the lateral acceleration
    # [rad s^2/m], see `ttempc.vehicle.Vehicle`
    compliance_s2pm: Compliance = 0.015


@dataclass(frozen=True, config=STRICT)
class FrontAxle:
    """The steered axle, which pivots in roll; its mass is without the wheels."""

    track_m: Positive  # between the centres of the front tyres, wheels straight
    kingpin_track_m: Positive  # distance between the kingpins
    mass_kg: Positive
    pivot_limit_deg: AngleDeg


@dataclass(frozen=True, kw_only=True, config=STRICT)
class Wheel(Tyre):
    """One of a pair of wheels."""

    mass_kg: Positive  # tyre and rim


@dataclass(frozen=True, config=STRICT)
class Hitch:
    """RJ1, the pin between tractor and drawbar."""

    offset_m: PlaceM  # a, behind the rear axle; 0: on it, below 0: before it
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
    compliance_s2pm: Compliance = 0.03  # as of the tractor, of the trailer axle


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
    height_m: Positive  # of the centre of mass
    forward_m: PlaceM  # centre ahead of the trailer axle


@dataclass(frozen=True, config=STRICT)
class Steering:
    """A steering valve with its cylinder."""

    limit_deg: AngleDeg  # stop, to each side
    rate_degps: Positive
    lag_s: Positive


@dataclass(frozen=True, config=STRICT)
class TrailerSteering(Steering):
    """Steering of the drawbar against the trailer; a plain trailer has none, its stop is 0."""

    limit_deg: Annotated[float, Field(ge=0, lt=90)] = 0.0
    rate_degps: Positive = 35.0  # of a plain trailer without effect
    lag_s: Positive = 0.2


@dataclass(frozen=True, config=STRICT)
class Hydrostat:
    """The drive, identified by a step test on firm level ground with an empty trailer."""

    speed_gain_mps: Positive  # K, steady speed at position 1
    time_constant_s: Positive  # tau
    rate_per_s: Positive  # largest rate of the position; the controller must not exceed it
    reverse: bool = False  # positions of -1..0 drive backward, with the same K and tau
    power_kw: Positive | None = None  # largest power at the driven wheels; absent: not limited


@dataclass(frozen=True, config=STRICT)
class PlantVehicle:
    """Vehicle whose parts fit together.

    Raises:
        InvalidPlant: the parts do not fit together: key, value and reason of the first check.
    """

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
    hydrostat: Hydrostat
    trailer_steering: TrailerSteering = TrailerSteering()

    def __post_init__(self) -> None:
        for keys, reason in _problems(self):
            given = attrgetter(*keys.split(", "))(self)
            raise InvalidPlant(f"{keys} = {given}: {reason}")

    @property
    def wheels(self) -> dict[str, Wheel]:
        """Wheels by the name of their axle."""
        return {"front": self.front_wheel, "rear": self.rear_wheel, "trailer": self.trailer_wheel}

    @property
    def trailer_behind_m(self) -> float:
        """Distance from the rear axle to the trailer axle on a straight line."""
        return self.hitch.offset_m + self.drawbar.length_m + self.trailer.length_m


def read_vehicle(name: str = DEFAULT_VEHICLE) -> PlantVehicle:
    """Return the vehicle of a file, given the name of a shipped vehicle or a path.

    Raises:
        InvalidPlant: there is no such file, a key or a value is not allowed (the message names
            file and key), or the parts do not fit together (the message gives the reason).
    """
    file = VEHICLES.find(name)
    return _vehicle(toml_text(file, InvalidPlant), str(file))


# A study asks for the same vehicle at each of its points: read from the disk, understood once.
@functools.lru_cache(_UNDERSTOOD)
def _vehicle(text: str, file: str) -> PlantVehicle:
    """Return the vehicle of a text, given the file that it was read from.

    Raises:
        InvalidPlant: see `read_vehicle`.
    """
    content = parse_toml(text, InvalidPlant, file)
    try:
        return validated(PlantVehicle, content, InvalidPlant)
    except InvalidPlant as error:
        raise InvalidPlant(f"{file}: {error}") from None


def vehicle_text(name: str) -> str:
    """Return the text of a vehicle file, as a log keeps it.

    Raises:
        InvalidPlant: there is no such file.
    """
    return read_bounded(VEHICLES.find(name)).decode()


@stdlib_dataclass(frozen=True, slots=True)
class AxleLoads:
    """Static load of each axle and of the pin between tractor and drawbar [N]."""

    front: float
    rear: float
    trailer: float
    pin: float  # downward on the tractor

    @classmethod
    def of(cls, vehicle: PlantVehicle) -> AxleLoads:
        """Return the static loads of a vehicle with its load."""
        tractor = vehicle.tractor
        drawbar = vehicle.drawbar
        trailer = vehicle.trailer
        load = vehicle.load
        reach = drawbar.length_m + trailer.length_m
        # drawbar and trailer are one beam in pitch: moments about the trailer axle, then about
        # the rear axle of the tractor
        ahead = (
            trailer.mass_kg * trailer.centre_forward_m
            + drawbar.mass_kg * (trailer.length_m + 0.5 * drawbar.length_m)
            + load.mass_kg * load.forward_m
        )
        pin = GRAVITY * ahead / reach
        front = (
            GRAVITY * tractor.mass_kg * tractor.centre_forward_m - pin * vehicle.hitch.offset_m
        ) / tractor.wheelbase_m
        towed = GRAVITY * (trailer.mass_kg + drawbar.mass_kg + load.mass_kg)
        return cls(front, GRAVITY * tractor.mass_kg + pin - front, towed - pin, pin)


def knuckle_angle(delta: FloatArray, wheelbase: float, kingpin_y: float) -> FloatArray:
    """Return the angle [rad] of the knuckle at `kingpin_y` [m], left positive (Ackermann).

    tan(knuckle) = L tan(delta) / (L - y tan(delta))
    """
    tangent = np.tan(delta)
    return np.arctan2(wheelbase * tangent, wheelbase - kingpin_y * tangent)


def _problems(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield the key and the problem of every impossible number."""
    yield from _problems_of_wheels(vehicle)
    yield from _problems_of_masses(vehicle)
    yield from _problems_of_loads(vehicle)
    yield from _problems_of_steering(vehicle)
    yield from _problems_of_drawbar(vehicle)
    yield from _problems_of_box(vehicle)


def _problems_of_wheels(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield key and problem of wheels that are no wheels, or that overlap."""
    tractor = vehicle.tractor
    axle = vehicle.front_axle
    front, rear, towed = vehicle.wheels.values()
    for pair, wheel in vehicle.wheels.items():
        if wheel.section_height_m >= wheel.radius_m:
            limit = f"must be below radius_m = {wheel.radius_m}, or there is no rim"
            yield f"{pair}_wheel.section_height_m", limit

    for key, track, wheel in (
        ("front_axle.track_m", axle.track_m, front),
        ("tractor.rear_track_m", tractor.rear_track_m, rear),
        ("trailer.track_m", vehicle.trailer.track_m, towed),
    ):
        if track <= wheel.width_m:
            yield key, f"narrower than a tyre of {wheel.width_m} m, its wheels overlap"
    if axle.kingpin_track_m >= axle.track_m:
        reason = f"the kingpins must stand inside the wheels, track_m = {axle.track_m}"
        yield "front_axle.kingpin_track_m", reason

    if tractor.wheelbase_m <= (radii := front.radius_m + rear.radius_m):
        yield "tractor.wheelbase_m", f"front and rear wheels overlap, must be above {radii:.3f}"
    behind = vehicle.trailer_behind_m
    if behind <= (radii := rear.radius_m + towed.radius_m):
        reason = f"its wheels overlap the tractor's; must be above {radii:.3f} m"
        yield "trailer.length_m", f"trailer axle {behind:.3f} m behind the rear axle, {reason}"


def _problems_of_masses(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield key and problem of masses and moments of inertia that no body has."""
    front, rear, towed = vehicle.wheels.values()
    axles_and_wheels_kg = vehicle.front_axle.mass_kg + 2.0 * (front.mass_kg + rear.mass_kg)
    for name, whole, parts in (
        ("tractor", vehicle.tractor, axles_and_wheels_kg),
        ("trailer", vehicle.trailer, 2.0 * towed.mass_kg),
    ):
        if whole.mass_kg <= parts:
            reason = f"masses do not add up, axles and wheels alone weigh {parts:g} kg"
            yield f"{name}.mass_kg", reason
        inertia = whole.chassis_inertia_kgm2
        if inertia is not None and 2.0 * max(inertia) > sum(inertia):
            reason = "no body has one moment of inertia above the sum of the others"
            yield f"{name}.chassis_inertia_kgm2", reason


def _problems_of_loads(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield key and problem of axles that carry nothing, and of a front that is too light."""
    loads = AxleLoads.of(vehicle)
    places = "trailer.centre_forward_m, load.forward_m"
    if loads.pin < 0.0:
        yield places, f"the trailer tips backwards, it lifts the hitch with {-loads.pin:.0f} N"
    if loads.trailer <= 0.0:
        yield places, "the trailer's wheels carry nothing, all of it hangs on the hitch"
    least = _LEAST_SHARE * (loads.front + loads.rear)
    for name, carried in (("front", loads.front), ("rear", loads.rear)):
        if carried < least:
            reason = f"{carried:.0f} N with the trailer hitched, must be at least {least:.0f} N"
            yield "tractor.centre_forward_m", f"the {name} axle carries {reason}"


def _problems_of_steering(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield key and problem of the inner wheel at the steering limit."""
    tractor = vehicle.tractor
    axle = vehicle.front_axle
    front = vehicle.front_wheel
    kingpin = 0.5 * axle.kingpin_track_m
    limit = np.radians(vehicle.front_steering.limit_deg)
    angle = float(knuckle_angle(limit, tractor.wheelbase_m, kingpin))
    if angle > math.radians(_WIDEST_KNUCKLE_DEG):
        reason = f"{math.degrees(angle):.0f} deg, at most {_WIDEST_KNUCKLE_DEG:g} deg are allowed"
        yield "front_steering.limit_deg", f"the inner wheel would turn by {reason}"

    arm = 0.5 * (axle.track_m - axle.kingpin_track_m) - 0.5 * front.width_m
    edge = kingpin + arm * math.cos(angle) - front.radius_m * math.sin(angle)
    if edge <= 0.5 * tractor.engine_width_m:
        reason = f"touches the body, tractor.engine_width_m = {tractor.engine_width_m}"
        where = f"the inner wheel comes {edge:.3f} m near to the middle and"
        yield "front_steering.limit_deg", f"{where} {reason}"


def _problems_of_drawbar(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield key and problem of a drawbar, as a line, between the rear wheels.

    At the height of the hitch a wheel reaches half a chord behind the axle. The drawbar begins at
    the hitch, so that the rest of this lies beside it; above the wheels it is free of them.
    """
    hitch = vehicle.hitch
    rear = vehicle.rear_wheel
    inside = 0.5 * (vehicle.tractor.rear_track_m - rear.width_m)
    above = hitch.height_m >= 2.0 * rear.radius_m
    half_chord = math.sqrt(max(0.0, rear.radius_m**2 - (hitch.height_m - rear.radius_m) ** 2))
    beside = -math.inf if above else half_chord - hitch.offset_m
    if vehicle.drawbar.length_m <= beside:
        reason = f"the drawbar ends between the rear wheels, must be above {beside:.3f}"
        yield "drawbar.length_m", reason
    largest = math.degrees(math.atan2(inside, beside))
    if hitch.yaw_limit_deg >= largest:
        reason = f"the drawbar meets the rear wheels at {largest:.0f} deg; lower it, or a hitch"
        where = f"hitched {hitch.offset_m} m behind the axle {reason}"
        yield "hitch.yaw_limit_deg", f"{where} above them (height_m >= {2.0 * rear.radius_m:g})"


def _problems_of_box(vehicle: PlantVehicle) -> Iterator[tuple[str, str]]:
    """Yield key and problem of a box that wheels reach into, and of a load outside of it."""
    box = vehicle.box
    load = vehicle.load
    rear = vehicle.rear_wheel
    towed = vehicle.trailer_wheel
    between = vehicle.trailer.track_m - towed.width_m
    top = 2.0 * towed.radius_m
    if box.floor_m <= top and box.width_m > between:
        reason = f"must be above {top} or the box narrower than {between:.3f} m"
        yield "box.floor_m", f"the wheels reach through the floor, {reason}"
    if vehicle.trailer_behind_m - box.forward_m - 0.5 * box.length_m <= rear.radius_m:
        yield "box.forward_m", "the box reaches into the tractor's rear wheels"

    if load.mass_kg > 0.0 and abs(load.forward_m - box.forward_m) > 0.5 * box.length_m:
        yield "load.forward_m", "the load's centre lies outside the box"
    if load.mass_kg > 0.0 and load.height_m <= box.floor_m:
        reason = f"the load's centre lies below the floor, {box.floor_m} m above the ground"
        yield "load.height_m", reason
