"""Autocorrelation of a receiver's errors: fitted to one half of a record, predicted on the other.

The record is that of `papers/receivers.py`: MatRTKLIB's car in Nagoya, 1,230 s, cut in the middle
of its time. Length, white share and share of the variance in the means are fitted to the correct
fixes of the first half as `receivers.correlation` fits them to all; lags and record are those of
the second.
"""

from typing import Final, NamedTuple

import numpy as np

from ..machine import Constant
from ..receivers import second_order

_TIME_S: Final = 17.3  # T, of the receiver at rest
_LENGTH_M: Final = 5.25  # L of the first half; of the second 5.01, of both 5.14
_CORRELATED_SHARE: Final = 0.960
_VARIANCE_IN_MEANS: Final = 0.151


class _Lag(NamedTuple):
    """Mean lag of pairs of epochs."""

    distance_m: float
    time_s: float


_LAGS: Final = (_Lag(2.03, 0.92), _Lag(4.48, 1.94), _Lag(8.89, 3.57))


def receiver_memory(wrong: Constant) -> list[float]:
    """Return the autocorrelation after three distances."""
    length = _LENGTH_M * wrong.of("receiver.length")
    figures = []
    for lag in _LAGS:
        course = np.array([lag.time_s / _TIME_S + lag.distance_m / length])
        correlated = _CORRELATED_SHARE * float(second_order(course)[0])
        figures.append((correlated - _VARIANCE_IN_MEANS) / (1.0 - _VARIANCE_IN_MEANS))
    return figures
