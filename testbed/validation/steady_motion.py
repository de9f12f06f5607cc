"""Steady motion of the vehicle from the planar balance of forces, without a simulation.

Tractor and trailer move in the plane on six wheels with the law of `soil_law`. The balances of
force and moment give yaw rate, lateral speed, hitch angle, traction and the slip of each wheel.
Linkage, servos, integration and the third dimension, which the plant adds, must not change the
result. The trailer is not steered.
"""

import math
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from scipy.optimize import fsolve

from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

from ..simulation.plant import Plant
from ..truth import WHEELS
from ..wheels.soil_law import SoilLaw
from ..wheels.tyre import Tyres, mobility
from .bench import DRIVEN, TRAILER, bodies, centre_of_mass, wheel_places

_FRONT: Final = ~(DRIVEN | TRAILER)
_MOST_SLIP: Final = 0.99  # that the search may try
_SLIP: Final = 0.02  # of the driven wheels where the search starts
_TRACTION: Final = 0.1  # of a driven wheel over its load, there


@dataclass(frozen=True, slots=True)
class Planar:
    """A planar vehicle in line: x ahead of the tractor point, y to its left."""

    lengths: Vehicle
    law: SoilLaw
    tyres: Tyres
    place: FloatArray  # (6, 2) [m] of the wheels
    kingpin_y: float  # [m] of the left one
    mass: tuple[float, float]  # [kg] of tractor and of trailer with drawbar
    centre_x: tuple[float, float]  # [m] of these

    @classmethod
    def of(cls, lengths: Vehicle, plant: Plant) -> Self:
        """Return the planar vehicle of a plant at the origin with heading 0."""
        towed = bodies(plant, "drawbar")
        tractor = [body for body in bodies(plant, "tractor") if body not in towed]
        mass, centre = centre_of_mass(plant, tractor)
        mass_towed, centre_towed = centre_of_mass(plant, towed)
        return cls(
            lengths,
            plant.wheel_law,
            plant.tyres,
            wheel_places(plant)[:, :2],
            float(plant.model.body("knuckle_left").pos[1]),
            (mass, mass_towed),
            (float(centre[0]), float(centre_towed[0])),
        )


@dataclass(frozen=True, slots=True)
class SteadyMotion:
    """Solution of the balances."""

    yaw_rate: float  # [rad/s]
    lateral_speed: float  # [m/s] of the tractor point to the left
    beta: float  # [rad] hitch angle psi_t - psi_d


def steady_motion(
    vehicle: Planar,
    delta_t: float,
    speed: float,
    load: FloatArray,
    cone_index: float,
    side_pull: float = 0.0,
) -> SteadyMotion:
    """Return the motion in which all forces balance, NaN where there is no solution.

    Args:
        vehicle: the vehicle.
        delta_t: front steering [rad].
        speed: of the tractor point along the tractor [m/s].
        load: on the wheels [N], (6,).
        cone_index: of the soil [kPa].
        side_pull: component of gravity to the left on a side slope [m/s^2].
    """
    lengths = vehicle.lengths
    cone_indices = np.full(len(WHEELS), cone_index)
    bn, mobility_number = mobility(vehicle.law, vehicle.tyres, load, cone_indices)
    heading = _wheel_headings(vehicle, math.tan(delta_t))
    balance = _Balance(vehicle, heading, speed, load, bn, mobility_number, side_pull)

    # From the circle of Ackermann, with slips of slow driving
    circle = speed * math.tan(delta_t) / lengths.wheelbase
    behind = lengths.hitch_offset + lengths.drawbar_length + lengths.trailer_length
    slip = np.where(DRIVEN, _SLIP, vehicle.law.towed_slip(bn))
    start = [circle, 0.0, circle * behind / speed, _TRACTION, *slip]
    solution, _, status, _ = fsolve(balance.imbalance, start, full_output=True)
    if status != 1:
        return SteadyMotion(math.nan, math.nan, math.nan)
    return SteadyMotion(*map(float, solution[:3]))


@dataclass(frozen=True, slots=True)
class _Balance:
    """Balance of a vehicle that circles steadily; arguments as of `steady_motion`."""

    vehicle: Planar
    heading: FloatArray  # of the wheels in their own body [rad], (6,)
    speed: float
    load: FloatArray
    bn: FloatArray  # mobility number Bn of the wheels, (6,)
    mobility_number: FloatArray  # mobility number M of the wheels, (6,)
    side_pull: float

    def imbalance(self, unknown: FloatArray) -> FloatArray:
        """Return what is left of forces, moments and torques, over half the driven load, (10,).

        `unknown` are yaw rate, lateral speed, hitch angle, traction of a driven wheel over half the
        driven load, and the slip of each wheel.
        """
        yaw_rate, lateral, beta, drive = unknown[:4]
        slip = np.clip(unknown[4:], -_MOST_SLIP, _MOST_SLIP)
        place, centres = self._bent(beta)
        half = 0.5 * self.load[DRIVEN].sum()

        def velocity(points: FloatArray) -> FloatArray:
            return np.column_stack(
                [self.speed - yaw_rate * points[:, 1], lateral + yaw_rate * points[:, 0]]
            )

        # Forces on the wheels; an open differential has one torque for both driven ones
        force, traction = self._wheel_forces(beta, slip, velocity(place))
        gross = np.where(DRIVEN, drive * half, 0.0)
        torque = self.load * (traction + self.vehicle.law.resistance_tyre) - gross

        # A body that circles steadily accelerates by yaw rate x velocity
        circling = velocity(centres)
        inertia = np.array(self.vehicle.mass)[:, None] * (
            yaw_rate * np.column_stack([-circling[:, 1], circling[:, 0]]) - [0.0, self.side_pull]
        )

        pin = self._pin
        total = force.sum(axis=0) - inertia.sum(axis=0)
        moment = _moment(place, force) - _moment(centres, inertia)
        about_pin = _moment(place[TRAILER] - pin, force[TRAILER]) - _moment(
            centres[1:] - pin, inertia[1:]
        )
        return np.array([*total, moment, about_pin, *torque]) / half

    @property
    def _pin(self) -> FloatArray:
        return np.array([-self.vehicle.lengths.hitch_offset, 0.0])

    def _bent(self, beta: float) -> tuple[FloatArray, FloatArray]:
        """Return wheels (6, 2) and centres of mass (2, 2) at a hitch angle, in tractor axes [m]."""
        pin = self._pin
        cosine = math.cos(beta)
        sine = math.sin(beta)
        turn = np.array([[cosine, sine], [-sine, cosine]])  # trailer's axes to the tractor's
        place = self.vehicle.place.copy()
        place[TRAILER] = pin + (place[TRAILER] - pin) @ turn.T
        centres = np.array([[x, 0.0] for x in self.vehicle.centre_x])
        centres[1] = pin + turn @ (centres[1] - pin)
        return place, centres

    def _wheel_forces(
        self, beta: float, slip: FloatArray, velocity: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return forces on the wheels (6, 2) [N], and gross traction over load (6,)."""
        law = self.vehicle.law
        heading = self.heading - beta * TRAILER
        ahead = np.column_stack([np.cos(heading), np.sin(heading)])
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        along = (velocity * ahead).sum(axis=1)
        across = (velocity * left).sum(axis=1)
        sliding = along * np.maximum(slip, 0.0) / (1.0 - np.maximum(slip, 0.0))
        slip_angle = np.arctan(across / np.maximum(along, sliding))
        traction, side = law.combined_ratios(self.bn, self.mobility_number, slip, slip_angle)
        pull = self.load * (traction - law.soil_resistance_ratio(self.bn, slip))
        force = pull[:, None] * ahead + (self.load * side)[:, None] * left
        return force, traction


def _wheel_headings(vehicle: Planar, tangent: float) -> FloatArray:
    """Return the headings of the wheels in their own body [rad], by Ackermann, (6,)."""
    wheelbase = vehicle.lengths.wheelbase
    heading = np.zeros(len(WHEELS))
    sides = np.sign(vehicle.place[:, 1])
    to_circle = wheelbase - sides[_FRONT] * vehicle.kingpin_y * tangent
    heading[_FRONT] = np.arctan2(wheelbase * tangent, to_circle)
    return heading


def _moment(places: FloatArray, forces: FloatArray) -> float:
    return float((places[:, 0] * forces[:, 1] - places[:, 1] * forces[:, 0]).sum())
