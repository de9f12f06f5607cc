"""Head-up display: headline, tilt and events over a picture, figures and legend in a band below."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from PIL import Image

from ttempc.types import FloatArray

from ...testbed.recording.channels import CONTROL, STATE
from ...testbed.recording.record import fault_spans
from .drawing import (
    ALARM,
    FAINT,
    FULL_SLIP,
    INK,
    PLAN,
    POINTS,
    REFERENCE,
    OverlayBox,
    Rgb,
    slip_colour,
    text_length,
)
from .playback import Ghost, Playback, newest_row

_MARGIN: Final = 14.0
_BOX: Final = 136.0  # height of the boxes in the band
_WIDTH, _BRIEF_WIDTH = 1280.0, 860.0  # of a frame 720 pixels high
_TRACE_WIDTH, _BRIEF_TRACE_WIDTH = 560.0, 420.0
_BARS_CM: Final = (5.0, 10.0, 20.0, 40.0, 80.0, 150.0, 300.0, 1000.0)  # ends of the error scale
_CAPTION_S: Final = 3.0  # film time for which an event is shown
_INPUTS: Final = (  # field, label, factor to the unit shown, unit
    ("delta_t_rad", "front steering", math.degrees(1.0), "°"),
    ("delta_i_rad", "trailer steering", math.degrees(1.0), "°"),
    ("hp", "hydrostat", 100.0, " %"),
)
_TRACE_S: Final = 30.0  # of the run in the trace; more in a fast film
_TRACE_FILM_S: Final = 6.0  # ... for as long as this in the film
_LEFT, _RIGHT, _TOP, _BOTTOM = 64.0, 14.0, 26.0, 18.0  # margins of the axes of the trace
_Share = TypeVar("_Share", float, FloatArray)
_TRACE_POINTS: Final = 400  # of a line at most: as many as the box has pixels


def error_scale_m(playbacks: Sequence[Playback]) -> float:
    """Return the cross-track error at the end of bars and trace [m], common to all runs."""
    errors = (error.cross_m for run in playbacks for error in run.errors.by_point.values())
    most_cm = max(100.0 * float(np.nanmax(np.abs(error), initial=0.0)) for error in errors)
    return 0.01 * next((step for step in _BARS_CM if step >= most_cm), _BARS_CM[-1])


@dataclass(frozen=True)
class Hud:
    """Head-up display of the pictures of one run.

    It covers the sky, and otherwise lies in a band below the picture: nothing hides the paths.
    """

    playback: Playback
    size: tuple[int, int]  # of the frame, the band included [pixels]
    error_m: float  # at the end of bars and trace
    speed: float = 0.0  # seconds of the run per second of film, 0 in a still
    ghosts: Sequence[Ghost] = ()
    exaggeration: float = 1.0
    brief: bool = False  # without legend, for a narrow picture
    plan: bool = False  # of a plan view

    @property
    def scale(self) -> float:
        """Pixels per unit of length, 1 in a frame of 1280 x 720."""
        width, height = self.size
        return max(min(height / 720.0, width / (_BRIEF_WIDTH if self.brief else _WIDTH)), 0.2)

    @property
    def view_size(self) -> tuple[int, int]:
        """Width and height of the picture above the band [pixels]."""
        width, height = self.size
        return width, height - round((_BOX + 2.0 * _MARGIN) * self.scale)

    def draw_onto(self, picture: Image.Image, time_s: float) -> None:
        """Draw the display of a time onto a frame, in place."""
        width, height = self.size
        margin = _MARGIN * self.scale
        self._headline(self.playback.title).paste_onto(picture, margin, margin)
        clock = self._clock(time_s)
        clock.paste_onto(picture, width - margin - clock.image.width, margin)
        below = clock.image.height + 1.5 * margin
        if faults := self._faults(time_s):
            faults.paste_onto(picture, margin, below)
        if caption := self._caption(time_s):
            caption.paste_onto(picture, 0.5 * (width - caption.image.width), below)
        bars = self._bars(time_s)
        top = height - margin - bars.image.height
        bars.paste_onto(picture, margin, top)
        right = width - margin
        if not self.brief:
            legend = self._legend()
            right -= legend.image.width
            legend.paste_onto(picture, right, top)
            right -= margin
        trace = self._trace(time_s)
        left = 2.0 * margin + bars.image.width
        if left + trace.image.width <= right + 1.0:
            trace.paste_onto(picture, 0.5 * (left + right - trace.image.width), top)

    def _headline(self, text: str, colour: Rgb = INK) -> OverlayBox:
        box = OverlayBox(24.0 + text_length(text, 15, bold=True), 34.0, self.scale)
        box.text(12.0, 17.0, text, points=15, bold=True, colour=colour)
        return box

    def _clock(self, time_s: float) -> OverlayBox:
        """Return time, speed and the tilt of the tractor, for the camera stays upright."""
        speed, roll, pitch = (
            self.playback.value(STATE, name, time_s)
            for name in ("v_mps", "roll_t_rad", "pitch_t_rad")
        )
        tilt = f"roll {math.degrees(roll):+.1f}°  pitch {-math.degrees(pitch):+.1f}°"
        film_speed = f"   {self.speed:g}x" if self.speed else ""
        return self._headline(f"{tilt}   {time_s:6.1f} s   {speed:4.2f} m/s{film_speed}")

    def _faults(self, time_s: float) -> OverlayBox | None:
        """Return the names of the faults that act, None without any."""
        spans = fault_spans(self.playback.record.events)
        names = [span.name for span in spans if span.start_s <= time_s < span.end_s]
        return self._headline(f"fault: {', '.join(names)}", ALARM) if names else None

    def _caption(self, time_s: float) -> OverlayBox | None:
        """Return the newest event if it is recent, else None."""
        shown_s = _CAPTION_S * max(self.speed, 1.0)
        recent = [e for e in self.playback.record.events if 0 <= time_s - e.time_s < shown_s]
        if not recent:
            return None
        lines = textwrap.wrap(recent[-1].text, 72)[:3]
        width = 32.0 + max(text_length(line, 15) for line in lines)
        box = OverlayBox(width, 14.0 + 22.0 * len(lines), self.scale)
        colour = {"info": INK, "warning": PLAN}.get(recent[-1].level, ALARM)
        for k, line in enumerate(lines):
            y = 18.0 + 22.0 * k
            box.text(0.5 * width, y, line, points=15, colour=colour, align="middle")
        return box

    def _bars(self, time_s: float) -> OverlayBox:
        """Return the cross-track errors and the inputs as bars."""
        box, errors = OverlayBox(392.0, _BOX, self.scale), self.playback.errors
        row = newest_row(errors.time_s, time_s)
        lines: list[tuple[str, float, float, Rgb, str]] = []  # label, share, zero, colour, text
        for point, each in errors.by_point.items():
            error = float(each.cross_m[row])
            text = "raised" if math.isnan(error) else f"{100.0 * error:+.1f} cm"
            share = 0.5 + 0.5 * error / self.error_m
            lines.append((f"{point} cross-track", share, 0.5, POINTS[point], text))
        table = self.playback.record[CONTROL]
        row = newest_row(table.time_s, time_s)
        for field, label, factor, unit in _INPUTS:
            low, high, sent, limited = (
                float(table[f"{field}_{part}"][row])
                for part in ("min", "max", "command", "limited")
            )
            share, zero = (sent - low) / (high - low), -low / (high - low)
            colour = ALARM if limited else INK
            lines.append((label, share, zero, colour, f"{factor * sent:.1f}{unit}"))
        step = (_BOX - 10.0) / len(lines)
        for k, (label, share, zero, colour, text) in enumerate(lines):
            y = 5.0 + (k + 0.5) * step
            box.text(12.0, y, label, points=13)
            if not math.isnan(share):
                box.bar((156.0, y - 6, 300.0, y + 6), share, colour, zero=zero)
            box.text(380.0, y, text, points=13, align="right")
        return box

    def _trace(self, time_s: float) -> OverlayBox:
        """Return the cross-track errors over the last seconds."""
        width, window_s = self._trace_width, self._window_s
        box = OverlayBox(width, _BOX, self.scale)
        box.text(12.0, 13.0, "cross-track error, left positive", points=12)
        box.text(width - _RIGHT, 13.0, f"last {window_s:g} s", points=12, align="right")
        for share in (-1.0, 0.0, 1.0):
            y = _height(share)
            box.line([(_LEFT, y), (width - _RIGHT, y)], FAINT, 1.0 if share else 1.6)
            text = f"{100.0 * share * self.error_m:+.0f} cm" if share else "0"
            box.text(_LEFT - 6.0, y, text, points=11, align="right", colour=FAINT)
        for point in self.playback.errors.by_point:
            line = self.trace_points(point, time_s)
            if len(line) > 1:
                box.line([(float(x), float(y)) for x, y in line], POINTS[point], 2.0)
        return box

    @property
    def _trace_width(self) -> float:
        return _BRIEF_TRACE_WIDTH if self.brief else _TRACE_WIDTH

    @property
    def _window_s(self) -> float:
        return max(_TRACE_S, _TRACE_FILM_S * self.speed)

    def trace_points(self, point: str, time_s: float) -> FloatArray:
        """Return the trace of a point of the vehicle in units of its box, (n, 2)."""
        errors, window_s = self.playback.errors, self._window_s
        first, last = np.searchsorted(errors.time_s, (time_s - window_s, time_s + 1e-9))
        stride = max(1, math.ceil((last - first) / _TRACE_POINTS))
        rows = np.arange(first - first % stride, last, stride)  # fixed to the run: no flicker
        age = (time_s - errors.time_s[rows]) / window_s
        share = np.clip(errors.by_point[point].cross_m[rows] / self.error_m, -1.0, 1.0)
        kept = np.isfinite(share) & (age <= 1.0)
        x = self._trace_width - _RIGHT - age * (self._trace_width - _LEFT - _RIGHT)
        return np.column_stack([x, _height(share)])[kept]

    def _legend(self) -> OverlayBox:
        """Return the names of what is drawn, and the colours of slip."""
        error = f", error x{self.exaggeration:g}" if self.exaggeration != 1.0 else ""
        marks = "dots" if self.plan else "poles"
        lines: list[tuple[str, Rgb | None]] = [
            ("reference path", REFERENCE),
            (f"tractor driven{error}", POINTS["tractor"]),
            (f"trailer driven{error}", POINTS["trailer"]),
            (f"{marks}: reference points", None),
        ]
        lines += [("predicted path", PLAN)] if any(self.playback.predicted) else []
        lines += [(f"ghost: {ghost.name}", ghost.colour) for ghost in self.ghosts]
        box = OverlayBox(254.0, _BOX, self.scale)
        step = (_BOX - 10.0) / (len(lines) + 1)
        points = min(13.0, 0.8 * step)
        for number, (name, colour) in enumerate(lines):
            y = 5.0 + (number + 0.5) * step
            if colour is None:
                box.rectangle(19.0, y - 6, 22.0, y + 6, POINTS["tractor"])
                box.rectangle(26.0, y - 6, 29.0, y + 6, POINTS["trailer"])
            else:
                box.rectangle(12.0, y - 2, 36.0, y + 2, colour)
            box.text(46.0, y, name, points=points)
        y = 5.0 + (len(lines) + 0.5) * step
        box.text(12.0, y, "slip 0", points=points)
        for k in range(30):
            x = 62.0 + 4.0 * k
            box.rectangle(x, y - 5.0, x + 4.0, y + 5.0, slip_colour(FULL_SLIP * k / 29.0))
        box.text(190.0, y, f"{100 * FULL_SLIP:.0f} %", points=points)
        return box


def _height(share: _Share) -> _Share:
    """Return the height of a share of the scale in the trace's box."""
    return 0.5 * (_TOP + _BOX - _BOTTOM) - 0.5 * share * (_BOX - _TOP - _BOTTOM)
