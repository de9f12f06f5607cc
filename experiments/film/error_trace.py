"""Running trace of the cross-track error, drawn as a box of the overlay."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..results.tracking_errors import BODIES
from .drawing.colours import FAINT, TRACTOR, TRAILER, brighter
from .drawing.overlay_box import OverlayBox
from .replay import Replay

WIDTH: Final = 560.0  # of the box, in its units
NARROW_WIDTH: Final = 420.0
_HEIGHT: Final = 136.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 64.0, 14.0, 26.0, 18.0  # margins of the axes
_STEPS_CM: Final = (2.0, 5.0, 10.0, 15.0, 20.0, 30.0, 40.0, 50.0, 75.0, 100.0, 150.0, 200.0, 500.0)
_POINTS: Final = 400  # of a line at most: as many as the box has pixels
_COLOURS: Final = {"tractor": brighter(TRACTOR), "trailer": brighter(TRAILER)}


def trace_scale_m(replays: Sequence[Replay]) -> float:
    """Return the cross-track error at the upper end of the axis [m], common to all runs."""
    errors = [getattr(replay.errors, body).cross_m for replay in replays for body in BODIES]
    most_cm = max(100.0 * float(np.nanmax(np.abs(error), initial=0.0)) for error in errors)
    return 0.01 * next((step for step in _STEPS_CM if step >= most_cm), _STEPS_CM[-1])


class ErrorTrace:
    """Trace of the cross-track error of both points over the last seconds.

    Args:
        replay: the run.
        window_s: length of the time axis; it ends now.
        scale_m: error at the upper end of the axis.
        narrow: whether the box is `NARROW_WIDTH` wide.
    """

    def __init__(self, replay: Replay, window_s: float, scale_m: float, *, narrow: bool) -> None:
        self._errors, self._window_s, self._scale_m = replay.errors, window_s, scale_m
        self._width = NARROW_WIDTH if narrow else WIDTH

    def box(self, time_s: float, scale: float) -> OverlayBox:
        """Return the box of a time, `scale` as of `OverlayBox`."""
        box = OverlayBox(self._width, _HEIGHT, scale)
        top, bottom = _TOP, _HEIGHT - _BOTTOM
        box.text(12.0, 13.0, "cross-track error, left positive", points=12)
        box.text(self._width - _RIGHT, 13.0, f"last {self._window_s:g} s", points=12, align="right")
        for share in (-1.0, 0.0, 1.0):
            y = 0.5 * (top + bottom) - 0.5 * share * (bottom - top)
            box.line([(_LEFT, y), (self._width - _RIGHT, y)], FAINT, 1.0 if share else 1.6)
            text = f"{100.0 * share * self._scale_m:+.0f} cm" if share else "0"
            box.text(_LEFT - 6.0, y, text, points=11, align="right", colour=FAINT)
        for body, colour in _COLOURS.items():
            points = self.points(body, time_s)
            if len(points) > 1:
                box.line([(float(x), float(y)) for x, y in points], colour, 2.0)
        return box

    def points(self, body: str, time_s: float) -> FloatArray:
        """Return the line of a point of the vehicle in units of the box, (n, 2)."""
        errors = self._errors
        first, last = np.searchsorted(errors.time_s, (time_s - self._window_s, time_s + 1e-9))
        stride = max(1, math.ceil((last - first) / _POINTS))
        rows = np.arange(first - first % stride, last, stride)  # fixed to the run: no flicker
        age = (time_s - errors.time_s[rows]) / self._window_s
        share = np.clip(getattr(errors, body).cross_m[rows] / self._scale_m, -1.0, 1.0)
        kept = np.isfinite(share) & (age <= 1.0)
        x = self._width - _RIGHT - age * (self._width - _LEFT - _RIGHT)
        y = 0.5 * (_TOP + _HEIGHT - _BOTTOM) - 0.5 * share * (_HEIGHT - _TOP - _BOTTOM)
        return np.column_stack([x, y])[kept]
