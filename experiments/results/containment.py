"""Whether the truth was where the tube said that it would be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from proving_ground.testbed.recording.channels import REFERENCE, STATE, TUBE
from proving_ground.testbed.recording.record import Record
from ttempc.types import FloatArray

from .tracking import START_UP_S, is_curved

QUANTITIES: Final = tuple(
    name.removesuffix("_nominal") for name in TUBE.fields if name.endswith("_nominal")
)
"""What a tube bounds: the errors of the minimal state, then x and y of the trailer point."""

_TRACTOR: Final = ("x_t_e_m", "y_t_e_m")
_TRAILER: Final = ("x_i_e_m", "y_i_e_m")
_PLAIN: Final = {  # the other errors: z_r - z of one column
    "psi_t_e_rad": "psi_t_rad",
    "psi_i_e_rad": "psi_i_rad",
    "delta_t_e_rad": "delta_t_rad",
    "delta_i_e_rad": "delta_i_rad",
    "v_e_mps": "v_mps",
}


@dataclass(frozen=True)
class Containment:
    """Deviation of the true error from the nominal one at control ticks after start-up."""

    time_s: FloatArray  # (n,)
    curved: NDArray[np.bool_]  # (n,)
    deviation: FloatArray  # (n, 9) in the order of `QUANTITIES`
    half_width: FloatArray  # (n, 9)

    POINTS: ClassVar = [QUANTITIES.index(name) for name in (*_TRACTOR, *_TRAILER)]
    ACROSS: ClassVar = {
        "tractor": QUANTITIES.index(_TRACTOR[1]),
        "trailer": QUANTITIES.index(_TRAILER[1]),
    }

    @property
    def share(self) -> FloatArray:
        """Return how much of its half width each deviation takes, at most 1 inside, (n, 9)."""
        return np.abs(self.deviation) / self.half_width


def containment(record: Record) -> Containment:
    """Return where in its tube a run was, at the times that state, reference and tube share."""
    tables = [record[channel] for channel in (TUBE, STATE, REFERENCE)]
    time_s = tables[0].time_s[tables[0].time_s >= START_UP_S]
    for table in tables[1:]:
        time_s = time_s[np.isin(time_s, table.time_s)]
    tube, state, reference = (np.searchsorted(table.time_s, time_s) for table in tables)
    error = _true_error(record, state, reference)
    nominal = record[TUBE].columns(*(f"{name}_nominal" for name in QUANTITIES))[tube]
    half_width = record[TUBE].columns(*(f"{name}_half_width" for name in QUANTITIES))[tube]
    return Containment(time_s, is_curved(record)[reference], error - nominal, half_width)


def _true_error(record: Record, state: NDArray[np.intp], reference: NDArray[np.intp]) -> FloatArray:
    """Return the errors z_e = T (z_r - z) of the truth, (n, 9)."""
    columns = {}
    for (x, y), letter in ((_TRACTOR, "t"), (_TRAILER, "i")):
        place = [f"x_{letter}_m", f"y_{letter}_m"]
        there = record[REFERENCE].columns(*place)[reference]
        dx, dy = (there - record[STATE].columns(*place)[state]).T
        heading = record[REFERENCE][f"psi_{letter}_rad"][reference]
        cos, sin = np.cos(heading), np.sin(heading)
        columns[x], columns[y] = cos * dx + sin * dy, cos * dy - sin * dx
    for name, field in _PLAIN.items():
        error = record[REFERENCE][field][reference] - record[STATE][field][state]
        if name.startswith("psi"):
            error = np.remainder(error + np.pi, 2.0 * np.pi) - np.pi
        columns[name] = error
    return np.column_stack([columns[name] for name in QUANTITIES])


def to_the_left(deviation: FloatArray) -> FloatArray:
    """Return how far left of the nominal vehicle a point is, for its deviation across [m].

    Errors are z_r - z: one that exceeds the nominal error means a vehicle to the right.
    """
    return -deviation
