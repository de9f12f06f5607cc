"""Roughness spectrum of the ground under the left and under the right wheels."""

from __future__ import annotations

from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import (
    HIGHEST_FREQUENCY,
    ISO_8608,
    LOWEST_FREQUENCY,
    REFERENCE_FREQUENCY,
    Terrain,
    flat,
)
from .bench import Bench, wheel_places
from .check import Chart, Check, Line, between, not_applicable

_BAND: Final = (0.1, 1.5)  # [cycle/m] in which the class is read
_LANE_M: Final = 3.0  # between passes


def roughness(bench: Bench) -> list[Check]:
    """Check G_d(n0) of both wheel tracks, the mean over passes across the field, by its class."""
    if bench.rough is None:
        return [
            not_applicable(f"roughness of the {side} track", "the ground has no ISO 8608 class")
            for side in ("left", "right")
        ]
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    half = 0.5 * float(np.ptp(wheel_places(plant)[2:4, 1]))
    expected = ISO_8608[bench.iso_class]
    lines, ratios = [], []
    for side, offset in (("left", half), ("right", -half)):
        frequency, density = section_spectrum(*_tracks(bench.rough, offset))
        inside = (frequency >= _BAND[0]) & (frequency <= _BAND[1])
        frequency, density = frequency[inside], density[inside]
        level = float(np.mean(density * (frequency / REFERENCE_FREQUENCY) ** 2))
        lines.append(Line(side, np.log10(frequency), np.log10(density)))
        ratios.append((side, level / expected))
    law = expected * (frequency / REFERENCE_FREQUENCY) ** -2
    chart = Chart(
        f"Roughness of both tracks, class {bench.iso_class}",
        "log10 of wave number [cycle/m]",
        "log10 of G_d [m³]",
        (*lines, Line("ISO 8608", np.log10(frequency), np.log10(law), False)),
    )
    return [
        between(
            f"roughness of the {side} track over class {bench.iso_class}",
            figure=ratio,
            low=0.5,
            high=2.0,
            unit="",
            source="ISO 8608:2016, table C.1: class limits are half and double the mean",
            note=f"the ground has waves of {LOWEST_FREQUENCY:g} to {HIGHEST_FREQUENCY:g} cycle/m; "
            "ISO 8608 covers 0.01 to 10",
            chart=chart if side == "left" else None,
        )
        for side, ratio in ratios
    ]


def section_spectrum(heights: FloatArray, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return frequency [cycle/m] and one-sided density [m^3], the mean over rows of heights [m]."""
    n = heights.shape[1]
    window = np.hanning(n)
    x = np.linspace(-1.0, 1.0, n)
    level = heights - heights.mean(axis=1, keepdims=True)
    level = level - (level @ x / (x @ x))[:, None] * x  # without the slope
    power = np.abs(np.fft.rfft(level * window, axis=1)) ** 2 * 2.0 * spacing / (window**2).sum()
    frequency: FloatArray = np.arange(power.shape[1]) / (n * spacing)
    return frequency, power.mean(axis=0)


def _tracks(terrain: Terrain, offset: float) -> tuple[FloatArray, float]:
    """Return the heights under one wheel along all passes, (passes, n) [m], and their spacing."""
    (x0, y0), (width, depth) = terrain.origin, terrain.size_m
    passes = np.arange(y0 + 2.0, y0 + depth - 2.0, _LANE_M)
    x = np.arange(x0, x0 + width, terrain.spacing_m)
    return terrain.height(x, passes[:, None] + offset), terrain.spacing_m
