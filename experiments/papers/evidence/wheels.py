"""Wheels on soil and tyres, by the plant's compiled and plain laws alone; no seed."""

import math
from copy import copy
from dataclasses import fields
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.ground.soil import NAMED_SOILS
from ....testbed.ground.surface import Grid
from ....testbed.ground.terrain import flat
from ....testbed.truth import WHEELS
from ....testbed.validation.bench import DRIVEN, Bench
from ....testbed.validation.single_manoeuvres import side_ratio
from ....testbed.vehicle.servos import tyres_of
from ....testbed.vehicle.vehicle import Wheel
from ....testbed.wheels import tyre
from ....testbed.wheels.ruts import Ruts, Strip, press, sinkage_of
from ....testbed.wheels.soil_law import SoilLaw
from ..machine import Constant, machine

SOILS: Final = {"soft or sandy": 20.0, "tilled": 40.0, "firm": 55.0, "hard": 80.0}
"""Mobility numbers of driven wheels by which ASABE D497 names soils, from secondary sources."""

_ANGLES: Final = (15.0, 30.0, 45.0)  # [deg]
_RIM_SPEEDS: Final = (1.3, 2.0, 0.8)  # over the speed of travel
_BEST_SLIPS: Final = (0.15, 0.12, 0.09, 0.06)  # middles of the published ranges
_SLIPS: Final = np.linspace(0.005, 0.5, 397)
_FRONT: Final = np.array([wheel.startswith("front") for wheel in WHEELS])
_REAR: Final = WHEELS.index("rear_left")
_FIELD_SLIP: Final = 0.20  # at which the National Institute states the coefficient of traction


def tyre_stiffness(wrong: Constant) -> list[float]:
    """Return the stiffness of a 495/70R24 tyre under 1,600 kg at 1 and 3 bar [kN/m].

    On level ground the load grows with the deflection to the power of 1.5.
    """
    load = 1600.0 * 9.81
    figures = []
    for pressure in (1.0, 3.0):
        wheel = Wheel(
            size="495/70R24",
            radius_m=0.6515,
            width_m=0.495,
            section_height_m=0.3467,
            rated_load_n=load,
            damping_spm=0.6,
            mass_kg=150.0,
            pressure_bar=pressure * wrong.of("tyre.pressure"),
        )
        assert wheel.relative_deflection is not None
        deflection = wheel.relative_deflection * wheel.section_height_m
        figures.append(1e-3 * 1.5 * load / deflection)
    return figures


def combined_slip(wrong: Constant) -> list[float]:
    """Return the loss of side force where the rim is faster or slower than the travel [%].

    Rim speeds of 1.3, 2 and 0.8 of the travel, at each slip angle of 15, 30 and 45 deg.
    """
    bench = machine(wrong).bench
    bn = SOILS["soft or sandy"]
    figures = []
    for degrees in _ANGLES:
        angle = math.radians(degrees)
        equal = side_ratio(bench, angle, 1.0, bn)
        for rim_speed in _RIM_SPEEDS:
            figures.append(100.0 * (1.0 - side_ratio(bench, angle, rim_speed, bn) / equal))
    return figures


def efficiency(wrong: Constant) -> list[float]:
    """Return what the tractive efficiency lacks of its best at the published best slip [points].

    On the four surfaces of the source, at the middle of its range of slips, of the driven wheel.
    """
    bench = machine(wrong).bench
    figures = []
    for bn, slip in zip(SOILS.values(), _BEST_SLIPS, strict=True):
        curve = _efficiency(bench, bn, pulled_share=0.0)
        at_slip = float(np.interp(slip, _SLIPS, curve))
        figures.append(100.0 * (float(curve.max()) - at_slip))
    return figures


def drawbar_power(wrong: Constant) -> list[float]:
    """Return the best drawbar power over axle power of the tractor alone on the surfaces [%]."""
    bench = machine(wrong).bench
    return [100.0 * float(_efficiency(bench, bn, pulled_share=1.0).max()) for bn in SOILS.values()]


def _efficiency(bench: Bench, bn: float, pulled_share: float) -> FloatArray:
    """Return drawbar power over axle power of the driven axle at `_SLIPS`, (n,).

    Args:
        bench: of the machine.
        bn: mobility number of the driven wheels under their static load.
        pulled_share: share of the front wheels' resistance that the axle bears.
    """
    tractor = bench.vehicle.tractor
    rear = tractor.mass_kg * (1.0 - tractor.centre_forward_m / tractor.wheelbase_m)
    front = tractor.mass_kg - rear
    transfer = bench.vehicle.hitch.height_m / tractor.wheelbase_m

    # the front wheels stand on the same soil
    law = _rear_law(bench)
    per_kpa = _mobility_per_kpa(bench, 0.5 * 9.81 * np.where(DRIVEN, rear, front))
    front_bn = bn * per_kpa[_FRONT].mean() / per_kpa[DRIVEN].mean()
    resistance = pulled_share * law.motion_resistance_ratio(np.array([front_bn]), np.zeros(1))

    # pull = net (rear + transfer pull) - resistance (front - transfer pull)
    numbers = np.full_like(_SLIPS, bn)
    net = law.net_traction_ratio(numbers, _SLIPS)
    gross = law.gross_traction_ratio(numbers, _SLIPS)
    pull = (net * rear - resistance * front) / (1.0 - transfer * (net + resistance))
    return pull / (gross * (rear + transfer * pull)) * (1.0 - _SLIPS)


def _rear_law(bench: Bench) -> SoilLaw:
    """Return the law of the rear tyre, its coefficients as floats."""
    law = copy(bench.wheel_law.of(tyres_of(bench.vehicle).radial))
    for field in fields(SoilLaw):
        value = getattr(law, field.name)
        if isinstance(value, np.ndarray):
            object.__setattr__(law, field.name, float(value[_REAR]))
    return law


def _mobility_per_kpa(bench: Bench, load_n: FloatArray) -> FloatArray:
    """Return the mobility number Bn of the wheels under loads on soil of 1 kPa, (6,)."""
    tyres = tyres_of(bench.vehicle)
    return tyre.mobility(bench.wheel_law, tyres, load_n, np.ones(len(WHEELS)))[0]


def second_pass(wrong: Constant) -> list[float]:
    """Return what a driven wheel gains in the rut of a first pass, means of the surfaces [%].

    Less rolling resistance, coefficient of traction at a slip of 20 %, best tractive efficiency.
    """
    bench = machine(wrong).bench
    gains = np.array([_gains_in_rut(bench, bn) for bn in SOILS.values()])
    return gains.mean(axis=0).tolist()


def _gains_in_rut(bench: Bench, bn: float) -> tuple[float, float, float]:
    """Return the gains of the rear wheel in its own rut on soil of a mobility number [%]."""
    law = _rear_law(bench)
    tyres = tyres_of(bench.vehicle)
    cone_index = bn / float(_mobility_per_kpa(bench, tyres.rated_load)[_REAR])
    sinking = 1.0 - cone_index / NAMED_SOILS["hard"]

    # work of the second pass over that of the first
    deflection = float(tyres.relative_deflection[_REAR] * tyres.section_height[_REAR])
    radius = float(tyres.radius[_REAR])
    width = float(tyres.width[_REAR])
    half_length = math.sqrt(deflection * (2.0 * radius - deflection))
    resistance = sinking * law.resistance_bn / bn
    first, second = _pass_works(width, sinkage_of(half_length, width, resistance))

    # the soil under a slip of zero resists with that share of its work
    numbers = np.full_like(_SLIPS, bn)
    saved = resistance * (1.0 - second / first)
    rolling = law.motion_resistance_ratio(np.array([bn]), np.zeros(1))[0]
    net = law.net_traction_ratio(numbers, _SLIPS)
    efficiency = net / law.gross_traction_ratio(numbers, _SLIPS) * (1.0 - _SLIPS)
    better = efficiency * (net + saved) / net
    traction = float(np.interp(_FIELD_SLIP, _SLIPS, net))
    return (
        100.0 * saved / float(rolling),
        100.0 * saved / traction,
        100.0 * (float(better.max() / efficiency.max()) - 1.0),
    )


def _pass_works(width: float, sinkage: float) -> tuple[float, float]:
    """Return the work of two passes of a tyre over that on new soil, by the kernel of the ruts."""
    spacing = 0.05
    ground = flat((6.0, 3.0), spacing)
    ruts = Ruts(ground.heights, np.zeros(ground.heights.shape), np.zeros((1, 3)))
    grid = Grid(*ground.origin, spacing)
    step = 0.025
    works = []
    for _ in range(2):
        strips = [
            Strip(x, 0.0, ahead=(1.0, 0.0), width=width, travel=step)
            for x in np.arange(-2.0, 2.0, step).tolist()
        ]
        works.append(float(np.mean([press(ruts, grid, strip, sinkage) for strip in strips])))
    first, second = works
    return first, second
