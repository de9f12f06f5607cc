"""Likelihood ratios of what may have begun at an onset: a drift, an error of the encoder."""

from typing import Final

import numpy as np

from .board import Record
from .ground import CHANGES, ONSETS, Change
from .history import kernel

_RATIOS: Final = np.dtype(
    [
        ("drift", "f8"),  # likelihood ratio of a drift where nothing else changes
        ("drift_mps", "f8", 2),  # that drift, east and north
        ("encoder", "f8"),  # likelihood ratio of an error of the encoder where nothing else changes
        ("beside", "f8"),  # what a drift explains beside an error of the encoder
    ]
)
"""Likelihood ratios of what may have begun at one moment, by both receivers."""

COMPARISON: Final = np.dtype(
    [
        ("ratios", _RATIOS, ONSETS),
        ("information", "f8", (CHANGES, CHANGES)),  # workspace: of an onset, by both receivers
        ("evidence", "f8", CHANGES),  # workspace: the same
    ]
)
"""Likelihood ratios of all onsets."""

# Standard deviations by `Change`: of a drift [m/s], and of an error of the encoder; assumed
_CHANGE_SD: Final = (0.15, 0.15, 0.1)
_LEAST_MISFIT: Final = 0.3


@kernel
def compare_changes(memory: Record, receivers: Record, number: int) -> None:
    """Write the likelihood ratios of an onset.

    With information C and evidence d of both receivers, see `observe_drift`, a part of the changes
    explains d' C^-1 d of its own rows and columns. What a drift explains beside an error of the
    encoder is that of C and d with this error eliminated: what both explain less what it explains.

    Args:
        memory: record `COMPARISON`.
        receivers: records `GROUND` of both.
        number: of the onset.
    """
    _sum_up(memory, receivers, number)
    ratios = memory.ratios[number]
    c = memory.information
    d = memory.evidence
    ratios.drift, east, north = _explained(c[0, 0], c[0, 1], c[1, 1], d[0], d[1])
    ratios.drift_mps[0] = east
    ratios.drift_mps[1] = north
    ratios.encoder = d[Change.ENCODER] ** 2 / c[Change.ENCODER, Change.ENCODER]

    share_0 = c[0, Change.ENCODER] / c[Change.ENCODER, Change.ENCODER]
    share_1 = c[1, Change.ENCODER] / c[Change.ENCODER, Change.ENCODER]
    ratios.beside, _, _ = _explained(
        c[0, 0] - share_0 * c[0, Change.ENCODER],
        c[0, 1] - share_0 * c[1, Change.ENCODER],
        c[1, 1] - share_1 * c[1, Change.ENCODER],
        d[0] - share_0 * d[Change.ENCODER],
        d[1] - share_1 * d[Change.ENCODER],
    )


@kernel
def _sum_up(memory: Record, receivers: Record, number: int) -> None:
    """Write information and evidence of an onset by both receivers, and of what is assumed."""
    memory.information[:] = 0.0
    memory.evidence[:] = 0.0
    for change in range(CHANGES):
        memory.information[change, change] = 1.0 / _CHANGE_SD[change] ** 2
    for body in range(2):
        receiver = receivers[body]
        onset = receiver.onsets[number]
        weight = 1.0 / max(receiver.misfit, _LEAST_MISFIT)
        for change in range(CHANGES):
            memory.evidence[change] += weight * onset.evidence[change]
            for other in range(CHANGES):
                memory.information[change, other] += weight * onset.information[change, other]


@kernel
def _explained(
    c_00: float, c_01: float, c_11: float, d_0: float, d_1: float
) -> tuple[float, float, float]:
    """Return d' C^-1 d, and both entries of C^-1 d."""
    determinant = c_00 * c_11 - c_01 * c_01
    east = (c_11 * d_0 - c_01 * d_1) / determinant
    north = (c_00 * d_1 - c_01 * d_0) / determinant
    return east * d_0 + north * d_1, east, north
