"""From what the stages of the loop hand on to the numbers of a channel's row, in its order."""

from __future__ import annotations

import math
from collections.abc import Sequence
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

from ..truth import Truth
from .channels import MEASUREMENT

NAN: Final = float("nan")
_COLUMN: Final = {  # of a sensor's first number in `channels.MEASUREMENT`
    Sensor.GNSS_TRACTOR: 0,
    Sensor.GNSS_TRAILER: 2,
    Sensor.STEERING_TRACTOR: 4,
    Sensor.STEERING_TRAILER: 5,
    Sensor.HITCH: 6,
    Sensor.ENCODER: 7,
    Sensor.IMU_TRACTOR: 8,
    Sensor.IMU_TRAILER: 11,
}


def state_row(truth: Truth) -> list[float]:
    """Return the row of `channels.STATE`."""
    tractor, trailer = truth.tractor, truth.trailer
    return [
        *(tractor.x, tractor.y, tractor.yaw, trailer.x, trailer.y, trailer.yaw),
        *(tractor.z, tractor.pitch, tractor.roll, trailer.z, trailer.pitch, trailer.roll),
        *(truth.psi_d, truth.beta, truth.delta_t, truth.delta_i, truth.hp),
        *(truth.speed, truth.lateral_speed, truth.yaw_rate_t, truth.yaw_rate_i, truth.rim_speed),
        *truth.set_points.tolist(),
    ]


def tyres_row(truth: Truth) -> list[float]:
    """Return the row of `channels.TYRES`."""
    wheels = truth.wheels
    parts = (
        *(wheels.load, wheels.slip, wheels.slip_angle, wheels.force_long, wheels.force_lat),
        *(wheels.cone_index, wheels.ground),
    )
    return np.array(parts).T.ravel().tolist()


def measurement_row(samples: Sequence[Measurement]) -> list[float]:
    """Return the row of `channels.MEASUREMENT` for samples of one moment."""
    row = [NAN] * len(MEASUREMENT.fields)
    for sample in samples:
        first = _COLUMN[sample.sensor]
        row[first : first + len(sample.value)] = sample.value
    return row


def estimate_row(estimate: Estimate) -> list[float]:
    """Return the row of `channels.ESTIMATE`."""
    x, y, psi_t, psi_i, delta_t, delta_i, v = estimate.state.tolist()
    # A sample that could not be weighed at all, as one that is not finite, has no innovation.
    weighed = [item for item in estimate.innovations if math.isfinite(item.normalised_squared)]
    return [
        *(x, y, psi_t, *estimate.trailer_xy.tolist(), psi_i),
        *(delta_t, delta_i, v, estimate.hitch_angle),
        *np.sqrt(np.diag(estimate.covariance)).tolist(),
        *estimate.disturbance.tolist(),
        *estimate.map_disturbance.tolist(),
        sum(item.normalised_squared for item in weighed),
        sum(item.dimension for item in weighed),
    ]


def control_row(step: ControlStep, vehicle: Vehicle) -> list[float]:
    """Return the row of `channels.CONTROL`; `vehicle` gives the bounds."""
    said = step.diagnostics
    parts = (
        *(said.feedforward, said.feedback, said.robust, said.total, step.command.as_array()),
        *(vehicle.input_min, vehicle.input_max, said.limited),
    )
    return np.array(parts, dtype=float).T.ravel().tolist()


def tracking_row(said: Diagnostics) -> list[float]:
    """Return the row of `channels.TRACKING`."""
    return [*_or_nan(said.tracking_error, 7), *_or_nan(said.modelling_error, 4)]


def tube_row(report: TubeReport) -> list[float]:
    """Return the row of `channels.TUBE`."""
    widths = [*report.nominal.tolist(), *report.half_width.tolist()]
    return [float(report.inside), report.margin, *widths]


def solver_row(said: Diagnostics) -> list[float]:
    """Return the row of `channels.SOLVER`."""
    report = said.solver
    fallback = float(bool(said.fallback))
    if report is None:
        return [NAN, NAN, NAN, NAN, fallback]
    return [
        *(float(report.accepted), float(report.iterations)),
        *(report.primal_residual, report.dual_residual, fallback),
    ]


def _or_nan(values: FloatArray | None, size: int) -> list[float]:
    return [NAN] * size if values is None else values.tolist()
