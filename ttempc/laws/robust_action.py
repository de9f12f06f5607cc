"""Robust action: deviation from the nominal state, saturated LQ law, ancillary law of a tube.

The nominal state zbar is an error in the frame of the reference, as the error z_e itself. The
deviation is m = z_e - zbar.
"""

from __future__ import annotations

import math
from typing import Final

from ..jit import cached_njit, record
from ..layout import TICK
from ..mpc.condensing import Stages, Work
from ..types import FloatArray
from .law_records import (
    ERRORS,
    GAIN_SCHEDULE,
    INPUTS,
    LAW,
    MEMORY,
    MODELLING_ERROR,
    ONE_STEP,
    OUTPUTS,
    OUTSIDE,
    STATES,
    TUBE_MPC,
    TUBE_REPORT,
    Law,
)

_TINY: Final = 1e-30  # keeps the autocorrelation of a signal of zeros finite
_TRAILER: Final = 2  # first output of the trailer point


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def advance(
    k: int, stages: Stages, error: FloatArray, inputs: FloatArray, result: FloatArray
) -> None:
    """Write the error z_e (7,) that follows on `error` (16,) and `inputs` (3,) of tick `k`."""
    for i in range(STATES):
        total = 0.0
        for c in range(ERRORS):
            total += stages.a[k, i, c] * error[c]
        for c in range(INPUTS):
            total += stages.b[k, i, c] * inputs[c]
        result[i] = total


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_deviation(k: int, law: Law, stages: Stages, memory: FloatArray, work: Work) -> None:
    """Write nominal state and deviation of tick `k` for the error in `Work.state`.

    Of one step, zbar is predicted from the last error and the input that was sent; of a tube it is
    the nominal state of its own. After a tick without a step both start at the error.
    """
    s = record(memory, MEMORY)
    kind = record(law.constants, LAW).kind
    continues = s.last_tick == k - 1
    if continues and kind == ONE_STEP:
        advance(k - 1, stages, s.error, s.previous, s.nominal)
        for i in range(STATES):
            s.nominal[i] += s.foreseen[i]
    for i in range(STATES):
        if not continues:
            s.nominal[i] = work.state[i]
        elif kind != ONE_STEP:
            s.nominal[i] = s.next_nominal[i]
        s.deviation[i] = work.state[i] - s.nominal[i]


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def gain_of_deviation(k: int, law: Law, memory: FloatArray, i: int) -> float:
    """Return K m of the input `i`, in units of its saturation where it has one."""
    s = record(memory, MEMORY)
    gains = record(law.schedule[k], GAIN_SCHEDULE).gains
    total = 0.0
    for j in range(STATES):
        total += gains[i, j] * s.deviation[j]
    return total


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def correlated_share(memory: FloatArray, i: int, signal: float, forgetting: float) -> float:
    """Return the lag-one autocorrelation r of the signal w of an input, within [0, 1].

    r = sum f^j w(k-j) w(k-j-1) / sum f^j (w(k-j)^2 + w(k-j-1)^2) / 2. Older products and powers
    weigh less by the factor f, `LAW.forgetting`, with each tick.
    """
    s = record(memory, MEMORY)
    last = s.last_signal[i]
    power = 0.5 * (signal * signal + last * last)
    s.last_signal[i] = signal
    s.product[i] = forgetting * s.product[i] + signal * last
    s.power[i] = forgetting * s.power[i] + power
    return min(max(s.product[i] / max(s.power[i], _TINY), 0.0), 1.0)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def act_on_residual(k: int, law: Law, stages: Stages, memory: FloatArray, tick: FloatArray) -> None:
    """Write the robust action u_m = k_s tanh(r K m / k_s) and the modelling error C m."""
    s = record(memory, MEMORY)
    t = record(tick, TICK)
    constants = record(law.constants, LAW)
    for i in range(INPUTS):
        signal = gain_of_deviation(k, law, memory, i)
        share = correlated_share(memory, i, signal, constants.forgetting)
        s.action[i] = constants.saturation[i] * math.tanh(signal * share)
    for p in range(OUTPUTS):
        total = 0.0
        for j in range(STATES):
            total += stages.outputs[k, p, j] * s.deviation[j]
        t.tracking[MODELLING_ERROR + p] = total


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def keep_to_tube(k: int, law: Law, gauge: float, memory: FloatArray, work: Work) -> None:
    """Let the MPC act on the nominal state, and write the ancillary action -K m.

    Outside the tube the nominal state restarts at the estimate, without an action. Disturbances act
    on both states, with their present estimates.
    """
    s = record(memory, MEMORY)
    if gauge > 1.0:
        s.fallback = OUTSIDE
    else:
        for i in range(STATES):
            work.state[i] = s.nominal[i]
    for i in range(INPUTS):
        work.previous[i] = s.feedback[i]
        s.action[i] = 0.0 if s.fallback != 0.0 else -gain_of_deviation(k, law, memory, i)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def write_robust_action(
    k: int, law: Law, stages: Stages, memory: FloatArray, work: Work, tick: FloatArray
) -> None:
    """Write nominal state, deviation, action and modelling error of tick `k`.

    `Work.state` has the error (16,), `Work.previous` u_e(k-1) (3,), as `MEMORY.previous`; they
    leave with those on which the MPC acts.
    """
    s = record(memory, MEMORY)
    kind = record(law.constants, LAW).kind
    write_deviation(k, law, stages, memory, work)
    gauge = 0.0
    if law.faces.shape[0]:
        tube = record(tick, TICK).tube
        gauge = report_tube(k, law, stages.outputs, s.nominal, s.deviation, tube)
    if kind == TUBE_MPC:
        keep_to_tube(k, law, gauge, memory, work)
    else:
        act_on_residual(k, law, stages, memory, tick)


@cached_njit(error_model="numpy", boundscheck=False, nogil=True)
def report_tube(
    k: int,
    law: Law,
    outputs: FloatArray,
    nominal: FloatArray,
    deviation: FloatArray,
    report: FloatArray,
) -> float:
    """Write a `TUBE_REPORT` of tick `k`; return the gauge of the deviation in its set.

    The set is {m : |F m| <= 1}, by its faces F: those of the tube at the tick, or those of a set of
    disturbances, one for all ticks. The gauge is the largest |F m|.
    """
    point = record(law.schedule[k], GAIN_SCHEDULE)
    r = record(report, TUBE_REPORT)
    row = min(k, law.faces.shape[0] - 1)
    gauge = 0.0
    for face in range(law.faces.shape[1]):
        value = 0.0
        for j in range(STATES):
            value += law.faces[row, face, j] * deviation[j]
        gauge = max(gauge, abs(value))
    r.inside = 1.0 if gauge <= 1.0 else 0.0
    r.margin = 1.0 - gauge

    # entries of the error, then x and y of the trailer point
    for i in range(STATES):
        r.nominal[i] = nominal[i]
    for i in range(2):
        value = 0.0
        for j in range(STATES):
            value += outputs[k, _TRAILER + i, j] * nominal[j]
        r.nominal[STATES + i] = value
    for i in range(STATES + 2):
        r.half_width[i] = point.half_widths[i]
    return gauge
