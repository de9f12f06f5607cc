"""Rows of the channels from the data of a control period, in the order of their fields."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import fields
from typing import Final

import numpy as np

from ttempc.types import (
    ControlStep,
    Diagnostics,
    Estimate,
    FloatArray,
    Measurement,
    Sensor,
    TubeReport,
)
from ttempc.vehicle import Vehicle

from ..truth import Tool, Truth, Wheels
from .channels import MEASUREMENT, MEASUREMENT_COLUMNS, REFERENCE

NAN: Final = float("nan")

_TRAILER_REFERENCE: Final = [
    REFERENCE.fields.index(name) for name in ("x_i_m", "y_i_m", "psi_i_rad")
]

_WHEEL_FIELDS: Final = tuple(item.name for item in fields(Wheels))


def state_row(truth: Truth) -> list[float]:
    """Return the row of `channels.STATE`."""
    tractor, trailer = truth.tractor, truth.trailer
    return [
        tractor.x,
        tractor.y,
        tractor.yaw,
        trailer.x,
        trailer.y,
        trailer.yaw,
        tractor.z,
        tractor.pitch,
        tractor.roll,
        trailer.z,
        trailer.pitch,
        trailer.roll,
        truth.psi_d,
        truth.beta,
        truth.delta_t,
        truth.delta_i,
        truth.hp,
        truth.speed,
        truth.lateral_speed,
        truth.yaw_rate_t,
        truth.yaw_rate_i,
        truth.rim_speed,
        *truth.set_points.tolist(),
    ]


def tyres_row(truth: Truth) -> list[float]:
    """Return the row of `channels.TYRES`."""
    quantities = (getattr(truth.wheels, name).tolist() for name in _WHEEL_FIELDS)
    return [value for wheel in zip(*quantities, strict=True) for value in wheel]


def tool_row(tool: Tool, reference: Sequence[float]) -> list[float]:
    """Return the row of `channels.TOOL`.

    Its reference lies as far behind the trailer's as the tool point behind the trailer point.

    Args:
        tool: of the truth.
        reference: row of `channels.REFERENCE` at this time.
    """
    x, y, yaw = (reference[index] for index in _TRAILER_REFERENCE)
    right, left = tool.depth[0], tool.depth[-1]
    return [
        tool.x,
        tool.y,
        x - tool.behind * math.cos(yaw),
        y - tool.behind * math.sin(yaw),
        float(tool.depth.mean()),
        float(left),
        float(right),
        float(tool.draft.sum()),
        float(tool.side.sum()),
        tool.lowered,
        tool.distance,
    ]


def measurement_rows(samples: Sequence[Measurement]) -> list[list[float]]:
    """Return the rows of `channels.MEASUREMENT` for samples that are delivered at one moment.

    A row holds one sample of a sensor: there are more rows than one where a sensor delivers several
    samples.
    """
    rows: list[list[float]] = []
    filled: Counter[Sensor] = Counter()  # rows with a sample of each sensor
    for sample in samples:
        number = filled[sample.sensor]
        filled[sample.sensor] += 1
        if number == len(rows):
            rows.append([NAN] * len(MEASUREMENT.fields))
        rows[number][MEASUREMENT_COLUMNS[sample.sensor]] = (*sample.value, sample.time_s)
    return rows


def estimate_row(estimate: Estimate) -> list[float]:
    """Return the row of `channels.ESTIMATE`."""
    x, y, psi_t, psi_i, delta_t, delta_i, v = estimate.state.tolist()
    # A sample that the filter could not weigh, such as one that is not finite, has no innovation.
    weighed = [item for item in estimate.innovations if math.isfinite(item.normalised_squared)]
    return [
        x,
        y,
        psi_t,
        *estimate.trailer_xy.tolist(),
        psi_i,
        delta_t,
        delta_i,
        v,
        estimate.hitch_angle,
        *np.sqrt(np.diag(estimate.covariance)).tolist(),
        *estimate.disturbance.tolist(),
        *estimate.map_disturbance.tolist(),
        sum(item.normalised_squared for item in weighed),
        sum(item.dimension for item in weighed),
    ]


def control_row(step: ControlStep, vehicle: Vehicle) -> list[float]:
    """Return the row of `channels.CONTROL`; `vehicle` gives the bounds."""
    diagnostics = step.diagnostics
    parts = (
        diagnostics.feedforward,
        diagnostics.feedback,
        diagnostics.robust,
        diagnostics.total,
        step.command.as_array(),
        vehicle.input_min,
        vehicle.input_max,
        diagnostics.limited,
    )
    return np.array(parts, dtype=float).T.ravel().tolist()


def tracking_row(diagnostics: Diagnostics) -> list[float]:
    """Return the row of `channels.TRACKING`."""
    return [*_or_nan(diagnostics.tracking_error, 7), *_or_nan(diagnostics.modelling_error, 4)]


def tube_row(report: TubeReport) -> list[float]:
    """Return the row of `channels.TUBE`."""
    widths = [*report.nominal.tolist(), *report.half_width.tolist()]
    return [float(report.inside), report.margin, *widths]


def solver_row(diagnostics: Diagnostics) -> list[float]:
    """Return the row of `channels.SOLVER`."""
    report = diagnostics.solver
    fallback = float(bool(diagnostics.fallback))
    if report is None:
        return [NAN, NAN, NAN, NAN, fallback]
    return [
        float(report.accepted),
        float(report.iterations),
        report.primal_residual,
        report.dual_residual,
        fallback,
    ]


def _or_nan(values: FloatArray | None, size: int) -> list[float]:
    return [NAN] * size if values is None else values.tolist()
