"""Containment of the true errors in the tube of the controller."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE, STATE, TUBE
from ...testbed.recording.record import Record
from .tracking_errors import body_error, counted, is_curved

QUANTITIES: Final = tuple(
    name.removesuffix("_nominal") for name in TUBE.fields if name.endswith("_nominal")
)
"""Quantities that a tube bounds: errors of the minimal state, then x and y of the trailer point."""

_POSITION_ERRORS: Final = {"tractor": ("x_t_e_m", "y_t_e_m"), "trailer": ("x_i_e_m", "y_i_e_m")}
_SCALAR_ERRORS: Final = {  # error z_r - z of one field
    "psi_t_e_rad": "psi_t_rad",
    "psi_i_e_rad": "psi_i_rad",
    "delta_t_e_rad": "delta_t_rad",
    "delta_i_e_rad": "delta_i_rad",
    "v_e_mps": "v_mps",
}


@dataclass(frozen=True)
class Containment:
    """Deviation of the true error from the nominal error at the control ticks after start-up."""

    time_s: FloatArray  # (n,)
    curved: NDArray[np.bool_]  # (n,)
    deviation: FloatArray  # (n, 9) in the order of `QUANTITIES`
    half_width: FloatArray  # (n, 9) of the tube

    POINTS: ClassVar = [
        QUANTITIES.index(name) for names in _POSITION_ERRORS.values() for name in names
    ]
    """Columns of the position errors of both axle points."""

    ACROSS: ClassVar = {body: QUANTITIES.index(y) for body, (_, y) in _POSITION_ERRORS.items()}
    """Column of the cross-track error of each body."""

    @property
    def normalised_deviation(self) -> FloatArray:
        """Absolute deviation over half width, (n, 9); at most 1 inside the tube."""
        return np.abs(self.deviation) / self.half_width

    @property
    def margin(self) -> FloatArray:
        """1 minus the largest normalised deviation of both true axle points, (n,); inside: >= 0."""
        return 1.0 - self.normalised_deviation[:, self.POINTS].max(axis=1)


def containment(record: Record) -> Containment:
    """Return the containment of a run at the common times of state, reference and tube."""
    tables = [record[channel] for channel in (TUBE, STATE, REFERENCE)]
    time_s = tables[0].time_s[counted(record, tables[0].time_s)]
    for table in tables[1:]:
        time_s = time_s[np.isin(time_s, table.time_s)]
    tube, state, reference = (np.searchsorted(table.time_s, time_s) for table in tables)
    error = _true_error(record, state, reference)
    nominal = record[TUBE].columns(*(f"{name}_nominal" for name in QUANTITIES))[tube]
    half_width = record[TUBE].columns(*(f"{name}_half_width" for name in QUANTITIES))[tube]
    return Containment(time_s, is_curved(record)[reference], error - nominal, half_width)


def _true_error(record: Record, state: NDArray[np.intp], reference: NDArray[np.intp]) -> FloatArray:
    """Return the true errors z_e = T (z_r - z), (n, 9), in the order of `QUANTITIES`."""
    columns = {}
    for body, (along, cross) in _POSITION_ERRORS.items():
        # The position errors of `tracking_errors` are z - z_r in the same frame.
        error = body_error(record, state, reference, body)
        columns[along], columns[cross] = -error.along_m, -error.cross_m
    for name, field in _SCALAR_ERRORS.items():
        error = record[REFERENCE][field][reference] - record[STATE][field][state]
        if name.startswith("psi"):
            error = np.remainder(error + np.pi, 2.0 * np.pi) - np.pi
        columns[name] = error
    return np.column_stack([columns[name] for name in QUANTITIES])
