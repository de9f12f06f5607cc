"""Traction: slip against drawbar pull, tractive efficiency against slip."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import flat
from ..simulation.plant import Plant
from ..truth import WHEELS
from ..wheels import tyre
from ..wheels.soil_law import SoilLaw
from ..wheels.wheel_models import wheel_model
from .bench import DRIVEN, FIRM_KPA, Bench, drive, steps
from .check import Chart, Check, Line, between, not_applicable

_SPEED: Final = 0.7  # [m/s]
_SETTLE_S: Final = 6.0
_MEAN_S: Final = 0.5
_SLIPS: Final = np.array([0.0, 0.03, 0.05, 0.07, 0.09, 0.11, 0.13, 0.16, 0.20])  # desired

# Slip at best tractive efficiency: University of Arizona Cooperative Extension. It names surfaces
# without a cone index; each is identified by the mobility number Bn that ASABE D497 gives for drive
# tyres (quoted from secondary sources: unconfirmed). Bn, not cone index: the same soil is firm for
# a light vehicle and soft for a heavy one.
_BANDS: Final = (  # surface, Bn, band
    ("soft soil", 20.0, (0.14, 0.16)),
    ("tilled soil", 40.0, (0.11, 0.13)),
    ("firm soil", 55.0, (0.08, 0.10)),
    ("concrete", 80.0, (0.04, 0.08)),
)


@dataclass(frozen=True, slots=True)
class Pull:
    """The vehicle in steady driving under a drawbar pull."""

    slip: float  # of the driven wheels, from rim and ground speed
    efficiency: float  # power of the driven axle's net pull over power of the drive
    load: FloatArray  # (6,) [N]


def slip_for(plant: Plant, load: FloatArray, cone_index: float, pull: float) -> float:
    """Return the slip at which traction less all motion resistance is the pull [N]; NaN if none."""
    slips = np.linspace(0.0, 0.9, 3601)
    surplus = np.array([_surplus(plant, load, cone_index, slip) for slip in slips]) - pull
    crossing = np.flatnonzero((surplus[:-1] <= 0.0) & (surplus[1:] > 0.0))
    if not crossing.size:
        return math.nan
    k = crossing[0]
    return float(slips[k] - surplus[k] * (slips[k + 1] - slips[k]) / (surplus[k + 1] - surplus[k]))


def _surplus(plant: Plant, load: FloatArray, cone_index: float, slip: float) -> float:
    law = plant.wheel_law
    bn, _ = tyre.mobility(law, plant.tyres, load, np.full(len(WHEELS), cone_index))
    slips = np.where(DRIVEN, slip, law.towed_slip(bn))
    return float(load @ law.net_traction_ratio(bn, slips))


def _pull(bench: Bench, plant: Plant, cone_index: float, slip: float) -> tuple[Pull, float]:
    """Drive under the pull that belongs to a slip; return the measured state and the law's slip."""
    load = plant.reset(-20.0, 0.0, 0.0, _SPEED).wheels.load
    pull = max(0.0, _surplus(plant, load, cone_index, slip))
    plant.data.xfrc_applied[plant.body_names.index("tractor"), 0] = -pull
    command = bench.command(_SPEED)
    plant.advance(command, steps(plant, _SETTLE_S))
    rows, loads = [], []
    hydrostat = plant.model.actuator("hydrostat").id
    for truth in (drive(plant, command, 0.02, 0.02)[0] for _ in range(round(_MEAN_S / 0.02))):
        power = plant.data.actuator_force[hydrostat] * plant.data.actuator_velocity[hydrostat]
        net = truth.wheels.force_long[DRIVEN].sum() * truth.speed
        rows.append((truth.speed, truth.rim_speed, net, power))
        loads.append(truth.wheels.load)
    speed, rim, net, power = np.mean(rows, axis=0)
    mean_load = np.mean(loads, axis=0)
    measured = Pull(float(1.0 - speed / rim), float(net / power), mean_load)
    return measured, slip_for(plant, mean_load, cone_index, pull)


def slip_against_pull(bench: Bench) -> list[Check]:
    """Check the slip of the driven wheels under drawbar pull by the traction equation."""
    checks = []
    for cone_index in dict.fromkeys((bench.cone_index, FIRM_KPA)):
        plant = bench.plant(flat((60.0, 10.0)), cone_index)
        load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
        free = slip_for(plant, load, cone_index, 0.0)
        pairs = [_pull(bench, plant, cone_index, slip) for slip in (free, free + 0.05, free + 0.10)]
        worst = max(abs(pull.slip - law) for pull, law in pairs)
        text = ", ".join(f"{pull.slip:.3f} ({law:.3f})" for pull, law in pairs)
        checks.append(
            between(
                f"slip under drawbar pull at {cone_index:.0f} kPa, off the law",
                figure=worst,
                low=0.0,
                high=0.005,
                unit="",
                source="Brixius 1987, traction equation",
                note=f"measured (law): {text}",
            )
        )
    return checks


def efficiency(bench: Bench) -> list[Check]:
    """Check the tractive efficiency of the driven axle over slip, and the slip of its maximum.

    It is net pull times speed over torque times wheel speed; by the law (1 - MRR / GTR) (1 - s).
    The published band is that of the surface nearest in Bn under the static load.
    """
    cone_index = bench.cone_index
    if not wheel_model(bench.wheels).follows_soil_law:
        reason = "Coulomb friction has no curve of traction over slip"
        return [
            not_applicable(f"tractive efficiency at {cone_index:.0f} kPa, off the law", reason),
            not_applicable("slip at best tractive efficiency", reason),
        ]
    plant = bench.plant(flat((60.0, 10.0)), cone_index)
    load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    free = slip_for(plant, load, cone_index, 0.0)
    pulls = [
        _pull(bench, plant, cone_index, slip)[0] for slip in (free, *_SLIPS[free + 0.005 < _SLIPS])
    ]
    slips = np.array([pull.slip for pull in pulls])
    measured = np.array([pull.efficiency for pull in pulls])
    # at the mean load, because a pull shifts load to the driven wheels
    law = np.array(
        [
            _efficiency(plant.wheel_law, _mobility(plant, pull.load, cone_index), pull.slip)
            for pull in pulls
        ]
    )
    bn_driven = _mobility(plant, load, cone_index)
    best = _best(slips, measured)
    surface, _, (low, high) = min(_BANDS, key=lambda band: abs(math.log(band[1] / bn_driven)))
    edge = min(max(best, low), high)
    lost = _efficiency(plant.wheel_law, bn_driven, best) - _efficiency(
        plant.wheel_law, bn_driven, edge
    )
    chart = Chart(
        f"Tractive efficiency, {cone_index:.0f} kPa",
        "slip",
        "tractive efficiency",
        (Line("plant", slips, measured), Line("(1 - MRR/GTR)(1 - s)", slips, law, False)),
    )
    return [
        between(
            f"tractive efficiency at {cone_index:.0f} kPa, off the law",
            figure=np.abs(measured - law).max(),
            low=0.0,
            high=0.015,
            unit="",
            source="Brixius 1987: (1 - MRR/GTR) (1 - s)",
            chart=chart,
        ),
        between(
            f"slip at best tractive efficiency, {surface}",
            figure=100.0 * best,
            low=100.0 * low,
            high=100.0 * high,
            unit="%",
            source="Univ. of Arizona Coop. Ext.; surface by Bn (ASABE D497, unconfirmed)",
            note=f"driven wheels at Bn = {bn_driven:.0f}; at {100.0 * edge:.1f} %, in the band, "
            f"the law is {100.0 * lost:.2f} points below its best efficiency",
        ),
    ]


def _best(slips: FloatArray, efficiency: FloatArray) -> float:
    """Return the slip of the largest efficiency, from a parabola through three samples."""
    order = np.argsort(slips)
    slips, efficiency = slips[order], efficiency[order]
    top = int(efficiency.argmax())
    if not 0 < top < len(slips) - 1:
        return float(slips[top])
    three = slice(top - 1, top + 2)
    square, linear, _ = np.polyfit(slips[three], efficiency[three], 2)
    return float(-0.5 * linear / square)


def _mobility(plant: Plant, load: FloatArray, cone_index: float) -> float:
    """Return the mobility number Bn of the driven wheels."""
    bn, _ = tyre.mobility(plant.wheel_law, plant.tyres, load, np.full(len(WHEELS), cone_index))
    return float(bn[DRIVEN].mean())


def _efficiency(law: SoilLaw, bn: float, slip: float) -> float:
    """Return the tractive efficiency of one wheel by the law."""
    number, slips = np.array([bn]), np.array([slip])
    net, gross = law.net_traction_ratio(number, slips), law.gross_traction_ratio(number, slips)
    return float(net[0] / gross[0] * (1.0 - slip))
