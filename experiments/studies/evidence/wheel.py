"""Wheels on soil: combined slip, slip at best tractive efficiency, second pass."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from ....testbed.ground.terrain import flat
from ....testbed.truth import WHEELS
from ....testbed.validation.bench import DRIVEN, Bench
from ....testbed.validation.check import Check, between
from ....testbed.validation.validate import validate
from ....testbed.vehicle.servos import tyres_of
from ....testbed.wheels import tyre
from ....testbed.wheels.soil_law import SoilLaw
from .evidence import ASSUMED_RULE, Evidence, around
from .handling import farm

# Mobility numbers of driven wheels by which ASABE D497 names soils (quoted from secondary sources).
SOILS: Final = {"soft or sandy": 20.0, "tilled": 40.0, "firm": 55.0, "hard": 80.0}

_SAND: Final = (  # slip angle [deg], slip, side force over that without slip (measured)
    (15.0, 0.23, 0.25 / 0.31),
    (15.0, 0.50, 0.18 / 0.31),
    (30.0, 0.23, 0.43 / 0.47),
    (30.0, 0.50, 0.31 / 0.47),
)
_SAND_POINTS: Final = 10.0  # [percentage points] band about the loss of side force; assumed
_ROLLED_M: Final = 5.0  # until the deflections of a tread are steady
_REAR: Final = WHEELS.index("rear_left")


def side_ratio(slip_angle: float, slip: float, bn: float) -> float:
    """Return side force over load of the farm machine's rear wheel in steady rolling.

    Args:
        slip_angle: of the wheel [rad].
        slip: driving positive.
        bn: mobility number of the wheel, at its rated load.
    """
    law = SoilLaw()
    bn_area, m_area = tyres_of(farm().vehicle).mobility_areas(law)[_REAR]
    numbers, m = np.array([bn]), np.array([bn * m_area / bn_area])
    # the slip angle of the law refers to the speed of travel, or of sliding where it is larger
    travel = max(math.cos(slip_angle), math.cos(slip_angle) * slip / (1.0 - slip))
    angle = np.arctan(np.array([math.sin(slip_angle) / travel]))
    traction, side = law.combined_ratios(numbers, m, slip, angle)
    pull = traction - law.soil_resistance_ratio(numbers, np.array([slip]))
    used = np.hypot(pull / law.largest_traction_ratio(numbers), side / law.largest_side_ratio(m))
    return float(side[0] / max(1.0, used[0]))


def combined_slip() -> list[Evidence]:
    """Return the loss of side force by longitudinal slip at 15 and 30 degrees."""
    items = []
    for degrees, slip, remaining in _SAND:
        free, loaded = (
            side_ratio(math.radians(degrees), each, SOILS["soft or sandy"]) for each in (0.0, slip)
        )
        loss = round(100.0 * (1.0 - remaining))
        check = between(
            f"loss of side force at {degrees:g} deg by a slip of {100.0 * slip:g} %",
            figure=100.0 * (1.0 - loaded / free),
            low=loss - _SAND_POINTS,
            high=loss + _SAND_POINTS,
            unit="%",
            source="wheel with grousers on sand, github.com/qishuny/3D-RFT-wheel, 3 trials a point",
            note=f"side force over load {abs(free):.2f} without slip, {abs(loaded):.2f} with it",
        )
        items.append(
            Evidence(
                check,
                f"{loss} %",
                f"± {_SAND_POINTS:g} points, assumed",
                "rear tyre of the farm machine at its rated load, Bn = 20, no seed. A small rigid "
                "wheel tells the shape of the law, not its size",
                above="the law adds both slips as one vector; sand goes on pushing the side of a "
                "sunk wheel",
            )
        )
    return items


def best_slip() -> list[Evidence]:
    """Return the slip at best tractive efficiency on the four surfaces of the source."""
    return [
        Evidence(
            check,
            f"{check.low:.0f}-{check.high:.0f} %",
            "the source's range; its surface is named by Bn",
            "farm machine under a drawbar pull, no seed",
            below="Brixius' equation has its best efficiency at less slip on such soil; the "
            "curve is flat there",
            above="Brixius' equation has its best efficiency at more slip on such soil; the "
            "curve is flat there",
        )
        for bn in SOILS.values()
        for check in (_efficiency(farm(), bn)[1],)
    ]


def second_pass() -> list[Evidence]:
    """Return the gain of best tractive efficiency of wheels that run in a rut."""
    bench = farm()
    rut = replace(bench, wheel_law=SoilLaw(second_pass=True))
    first, second = (_best(_efficiency(each, SOILS["tilled"])[0]) for each in (bench, rut))
    low, high = around(5.0)
    check = between(
        "gain of best tractive efficiency on a second pass in the same track",
        figure=100.0 * (second / first - 1.0),
        low=low,
        high=high,
        unit="%",
        source="NIAE, 13.6-38 tyre, 19 fields: traction + 7 %, rolling resistance - 11 %",
        note=f"efficiency {first:.3f} and {second:.3f}",
    )
    return [
        Evidence(
            check,
            "+ 5 %",
            ASSUMED_RULE,
            "rear wheels of the farm machine in the ruts of its front wheels, option "
            "`second_pass`, tilled soil (Bn = 40), no seed. The option's coefficients are the "
            "source's means of traction and resistance; the efficiency is not put in",
            below="at best efficiency motion resistance is a small share of gross traction, so "
            "that 11 % of it is worth little; the slip at which the source compares is not known",
        )
    ]


def _efficiency(bench: Bench, bn: float) -> list[Check]:
    """Return the checks of tractive efficiency on soil of a mobility number of driven wheels."""
    plant = bench.plant(flat((20.0, 10.0)))
    load = plant.reset(0.0, 0.0, 0.0, 0.0).wheels.load
    per_kpa = tyre.mobility(bench.wheel_law, plant.tyres, load, np.ones(len(WHEELS)))[0]
    soil = replace(bench.soil, background=bn / float(per_kpa[DRIVEN].mean()))
    return [*validate(replace(bench, soil=soil), ("tractive efficiency",))]


def _best(check: Check) -> float:
    """Return the largest measured efficiency of a check's chart."""
    assert check.chart is not None
    return float(check.chart.lines[0].y.max())
