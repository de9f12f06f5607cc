"""Checks of a vehicle: overlapping parts, inconsistent masses, axles without load."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ..errors import InvalidPlant
from .axle_loads import AxleLoads
from .linkage import knuckle_angle
from .vehicle_parts import VehicleParts, Wheel

_LEAST_SHARE: Final = 0.05  # of the tractor's weight on each axle; it must steer and drive
_WIDEST_KNUCKLE_DEG: Final = 65.0  # beyond it the quartic of MuJoCo's coupling does not fit


def check_vehicle(vehicle: VehicleParts) -> None:
    """Refuse a vehicle whose parts are valid but do not fit together.

    Raises:
        InvalidPlant: for the first failed check: key, value and permitted values.
    """
    for check in (
        _check_wheels,
        _check_places,
        _check_masses,
        _check_axle_loads,
        _check_front_steering,
        _check_drawbar_swing,
        _check_box,
    ):
        check(vehicle)


def _refuse(key: str, given: object, reason: str) -> None:
    raise InvalidPlant(f"{key} = {given}: {reason}")


def _check_wheels(vehicle: VehicleParts) -> None:
    for pair, wheel in vehicle.wheels.items():
        if wheel.section_height_m >= wheel.radius_m:
            _refuse(
                f"{pair}_wheel.section_height_m",
                wheel.section_height_m,
                f"must be below radius_m = {wheel.radius_m}, or there is no rim",
            )


def _check_places(vehicle: VehicleParts) -> None:
    """Refuse wheels that overlap, in a pair or from axle to axle."""
    tractor, axle, trailer = vehicle.tractor, vehicle.front_axle, vehicle.trailer
    for key, track, wheel in (
        ("front_axle.track_m", axle.track_m, vehicle.front_wheel),
        ("tractor.rear_track_m", tractor.rear_track_m, vehicle.rear_wheel),
        ("trailer.track_m", trailer.track_m, vehicle.trailer_wheel),
    ):
        if track <= wheel.width_m:
            _refuse(key, track, f"narrower than a tyre of {wheel.width_m} m, its wheels overlap")
    if axle.kingpin_track_m >= axle.track_m:
        _refuse(
            "front_axle.kingpin_track_m",
            axle.kingpin_track_m,
            f"the kingpins must stand inside the wheels, track_m = {axle.track_m}",
        )
    front, rear, towed = (wheel.radius_m for wheel in vehicle.wheels.values())
    if tractor.wheelbase_m <= front + rear:
        _refuse(
            "tractor.wheelbase_m",
            tractor.wheelbase_m,
            f"front and rear wheels overlap, must be above {front + rear:.3f}",
        )
    behind = vehicle.hitch.offset_m + vehicle.drawbar.length_m + trailer.length_m
    if behind <= rear + towed:
        _refuse(
            "trailer.length_m",
            trailer.length_m,
            f"trailer axle {behind:.3f} m behind the rear axle, its wheels overlap the tractor's; "
            f"must be above {rear + towed:.3f} m",
        )


def _check_masses(vehicle: VehicleParts) -> None:
    axle = vehicle.front_axle.mass_kg
    front, rear, towed = (2.0 * wheel.mass_kg for wheel in vehicle.wheels.values())
    for key, whole, parts in (
        ("tractor.mass_kg", vehicle.tractor.mass_kg, axle + front + rear),
        ("trailer.mass_kg", vehicle.trailer.mass_kg, towed),
    ):
        if whole <= parts:
            _refuse(key, whole, f"masses do not add up, axles and wheels alone weigh {parts:g} kg")
    for key, inertia in (
        ("tractor.chassis_inertia_kgm2", vehicle.tractor.chassis_inertia_kgm2),
        ("trailer.chassis_inertia_kgm2", vehicle.trailer.chassis_inertia_kgm2),
    ):
        if inertia is not None and 2.0 * max(inertia) > sum(inertia):
            _refuse(key, inertia, "no body has one moment of inertia above the sum of the others")


def _check_axle_loads(vehicle: VehicleParts) -> None:
    loads = AxleLoads.of(vehicle)
    if loads.pin < 0.0:
        _refuse(
            "trailer.centre_forward_m, load.forward_m",
            (vehicle.trailer.centre_forward_m, vehicle.load.forward_m),
            f"the trailer tips backwards, it lifts the hitch with {-loads.pin:.0f} N",
        )
    if loads.trailer <= 0.0:
        _refuse(
            "trailer.centre_forward_m, load.forward_m",
            (vehicle.trailer.centre_forward_m, vehicle.load.forward_m),
            "the trailer's wheels carry nothing, all of it hangs on the hitch",
        )
    least = _LEAST_SHARE * (loads.front + loads.rear)
    for axle, load in (("front", loads.front), ("rear", loads.rear)):
        if load < least:
            _refuse(
                "tractor.centre_forward_m",
                vehicle.tractor.centre_forward_m,
                f"the {axle} axle carries {load:.0f} N with the trailer hitched, "
                f"must be at least {least:.0f} N",
            )


def _check_front_steering(vehicle: VehicleParts) -> None:
    """Refuse a steering limit at which the inner wheel turns too far or touches the body."""
    axle, wheel, limit = vehicle.front_axle, vehicle.front_wheel, vehicle.front_steering.limit_deg
    kingpin, wheelbase = 0.5 * axle.kingpin_track_m, vehicle.tractor.wheelbase_m
    angle = float(knuckle_angle(np.radians(limit), wheelbase, kingpin))
    if angle > math.radians(_WIDEST_KNUCKLE_DEG):
        _refuse(
            "front_steering.limit_deg",
            limit,
            f"the inner wheel would turn by {math.degrees(angle):.0f} deg, "
            f"at most {_WIDEST_KNUCKLE_DEG:g} deg are allowed",
        )
    arm = 0.5 * (axle.track_m - axle.kingpin_track_m) - 0.5 * wheel.width_m
    edge = kingpin + arm * math.cos(angle) - wheel.radius_m * math.sin(angle)
    if edge <= 0.5 * vehicle.tractor.engine_width_m:
        _refuse(
            "front_steering.limit_deg",
            limit,
            f"the inner wheel comes {edge:.3f} m near to the middle and touches the body, "
            f"tractor.engine_width_m = {vehicle.tractor.engine_width_m}",
        )


def _check_drawbar_swing(vehicle: VehicleParts) -> None:
    """Refuse a hitch limit at which the drawbar, as a line, meets the rear wheels."""
    hitch, wheel = vehicle.hitch, vehicle.rear_wheel
    inside = 0.5 * (vehicle.tractor.rear_track_m - wheel.width_m)
    beside = _chord(wheel, hitch.height_m) - hitch.offset_m  # wheels that stand behind the hitch
    if vehicle.drawbar.length_m <= beside:
        _refuse(
            "drawbar.length_m",
            vehicle.drawbar.length_m,
            f"the drawbar ends between the rear wheels, must be above {beside:.3f}",
        )
    largest = math.degrees(math.atan2(inside, beside))
    if hitch.yaw_limit_deg >= largest:
        _refuse(
            "hitch.yaw_limit_deg",
            hitch.yaw_limit_deg,
            f"hitched {hitch.offset_m} m behind the axle the drawbar meets the rear wheels "
            f"at {largest:.0f} deg",
        )


def _chord(wheel: Wheel, height_m: float) -> float:
    """Return half the length of a wheel at a height above the ground [m]."""
    return math.sqrt(max(0.0, wheel.radius_m**2 - (height_m - wheel.radius_m) ** 2))


def _check_box(vehicle: VehicleParts) -> None:
    box, wheel, trailer, load = vehicle.box, vehicle.trailer_wheel, vehicle.trailer, vehicle.load
    if box.floor_m <= 2.0 * wheel.radius_m and box.width_m > trailer.track_m - wheel.width_m:
        _refuse(
            "box.floor_m",
            box.floor_m,
            f"the wheels reach through the floor, must be above {2.0 * wheel.radius_m} "
            f"or the box narrower than {trailer.track_m - wheel.width_m:.3f} m",
        )
    behind = vehicle.hitch.offset_m + vehicle.drawbar.length_m + trailer.length_m
    front = behind - box.forward_m - 0.5 * box.length_m
    if front <= vehicle.rear_wheel.radius_m:
        _refuse("box.forward_m", box.forward_m, "the box reaches into the tractor's rear wheels")
    if load.mass_kg == 0.0:
        return
    if abs(load.forward_m - box.forward_m) > 0.5 * box.length_m:
        _refuse("load.forward_m", load.forward_m, "the load's centre lies outside the box")
    if load.height_m <= box.floor_m:
        _refuse(
            "load.height_m",
            load.height_m,
            f"the load's centre lies below the floor, {box.floor_m} m above the ground",
        )
