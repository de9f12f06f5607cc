"""Articulated kinematics: yaw rate of the trailer, sign of each term, chain of lengths."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import flat
from .bench import SPEED, Bench, steps
from .check import Check, between

_EVERY_S: Final = 0.02
_ROWS: Final = 750
_SETTLED: Final = 50  # rows


def hitch_kinematics(bench: Bench) -> list[Check]:
    """Check the yaw rate of a weaving trailer by rolling without slip, lambda = psi_t - psi_i.

    psi_i' (L_i + d cos delta_i) = v sin lambda - a psi_t' cos lambda - d delta_i' cos delta_i
    """
    vehicle = bench.nominal
    plant = bench.plant(flat((60.0, 60.0)))
    plant.reset(-20.0, 0.0, 0.0, SPEED)
    rows, gaps = [], []
    for k in range(_ROWS):
        t = _EVERY_S * k
        command = bench.command(SPEED, 0.25 * math.sin(0.5 * t), 0.3 * math.sin(1.3 * t))
        truth = plant.advance(command, steps(plant, _EVERY_S))
        lam = truth.tractor.yaw - truth.trailer.yaw
        rows.append((truth.speed, lam, truth.delta_i, truth.yaw_rate_t, truth.yaw_rate_i))
        chain = sum(
            length * np.array([math.cos(yaw), math.sin(yaw)])
            for length, yaw in (
                (vehicle.hitch_offset, truth.tractor.yaw),
                (vehicle.drawbar_length, truth.psi_d),
                (vehicle.trailer_length, truth.trailer.yaw),
            )
        )
        axles = np.array([truth.tractor.x - truth.trailer.x, truth.tractor.y - truth.trailer.y])
        gaps.append(np.linalg.norm(axles - chain))
    v, lam, delta_i, rate_t, rate_i = np.array(rows).T
    delta_i_rate = np.gradient(delta_i, _EVERY_S)
    drawbar = vehicle.drawbar_length * np.cos(delta_i)
    terms = np.array(
        [
            v * np.sin(lam),
            -vehicle.hitch_offset * rate_t * np.cos(lam),
            -drawbar * delta_i_rate,
        ]
    )  # (3, rows)

    def residual(signs: FloatArray) -> float:
        error = rate_i - signs @ terms / (vehicle.trailer_length + drawbar)
        return float(np.sqrt(np.mean(error[_SETTLED:] ** 2)))

    right = residual(np.ones(3))
    source = "rolling without side slip behind two hinges, docs/architecture.md"
    checks = [
        between(
            "trailer yaw rate, rms residual",
            figure=right,
            low=0.0,
            high=0.01,
            unit="rad/s",
            source=source,
            note=f"of {np.sqrt(np.mean(rate_i**2)):.3f} rad/s rms",
        ),
        between(
            "axle points against the chain of lengths",
            figure=1e3 * max(gaps),
            low=0.0,
            high=5.0,
            unit="mm",
            source="e(psi) summed over a, d and L_i",
        ),
    ]
    for index, term in enumerate(("v sin lambda", "a psi_t' cos lambda", "d delta_i' cos delta_i")):
        signs = np.ones(3)
        signs[index] = -1.0
        name = f"residual with the sign of {term} flipped, over that without"
        checks.append(
            between(
                name,
                figure=residual(signs) / right,
                low=3.0,
                high=math.inf,
                unit="",
                source=source,
            )
        )
    return checks
