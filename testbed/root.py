"""Root of a function of one variable."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

_TOLERANCE: Final = 2e-12
_RELATIVE: Final = 8.881784197001252e-16  # four units in the last place
_MOST: Final = 100  # steps, as scipy's


def bracketed_root(function: Callable[[float], float], low: float, high: float) -> float:
    """Return a root of `function` between `low` and `high`, by the method of Brent (1973).

    The steps and the result are those of scipy's `brentq`. A plant needs one root when it is made,
    and scipy.optimize takes 20 MB and 0.15 s to load.

    Raises:
        ValueError: the function has the same sign at both ends, or does not converge.
    """
    before, now = low, high
    f_before, f_now = function(before), function(now)
    if f_before == 0.0:
        return before
    if f_now == 0.0:
        return now
    if (f_before < 0.0) == (f_now < 0.0):
        raise ValueError(f"no change of sign between {low:g} and {high:g}")
    other, f_other, last_step, step = before, f_before, 0.0, 0.0  # other end of the bracket
    for _ in range(_MOST):
        if f_before != 0.0 and f_now != 0.0 and (f_before < 0.0) != (f_now < 0.0):
            other, f_other = before, f_before
            last_step = step = now - before
        if abs(f_other) < abs(f_now):
            before, now, other = now, other, now
            f_before, f_now, f_other = f_now, f_other, f_now
        least = 0.5 * (_TOLERANCE + _RELATIVE * abs(now))
        half = 0.5 * (other - now)
        if f_now == 0.0 or abs(half) < least:
            return now
        trial = half
        if abs(last_step) > least and abs(f_now) < abs(f_before):
            if before == other:  # secant
                trial = -f_now * (now - before) / (f_now - f_before)
            else:  # inverse quadratic interpolation
                by_before = (f_before - f_now) / (before - now)
                by_other = (f_other - f_now) / (other - now)
                difference = f_other * by_other - f_before * by_before
                trial = -f_now * difference / (by_other * by_before * (f_other - f_before))
            if 2.0 * abs(trial) < min(abs(last_step), 3.0 * abs(half) - least):
                last_step, step = step, trial
            else:
                last_step = step = half
        else:
            last_step = step = half
        before, f_before = now, f_now
        now += step if abs(step) > least else (least if half > 0.0 else -least)
        f_now = function(now)
    raise ValueError(f"no root within {_MOST} steps between {low:g} and {high:g}")
