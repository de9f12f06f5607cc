"""Overlay of a picture: run, time, speed, tilt, errors and their trace, inputs, legend, events."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Self

import numpy as np
from PIL import Image

from ...testbed.recording.channels import CONTROL, STATE
from ...testbed.recording.record import fault_spans
from ..results.tracking_errors import BODIES, BodyError
from .drawing.colours import (
    ALARM,
    FAINT,
    FULL_SLIP,
    INK,
    PLAN,
    REFERENCE,
    TRACTOR,
    TRAILER,
    Rgb,
    brighter,
    slip_colour,
)
from .drawing.overlay_box import OverlayBox, text_length
from .error_trace import ErrorTrace, trace_scale_m
from .ghosts import Ghost
from .replay import Replay, newest_row
from .shot import Shot

_MARGIN: Final = 14.0
_MIN_FULL_ERROR_M: Final = 0.4  # smallest error at the end of an error bar
_LINE: Final = 21.0  # of the legend
_CAPTION_S: Final = 3.0  # film time for which an event is shown
_INPUTS: Final = (  # field, label, factor to the unit shown, unit
    ("delta_t_rad", "front steering", math.degrees(1.0), "°"),
    ("delta_i_rad", "trailer steering", math.degrees(1.0), "°"),
    ("hp", "hydrostat", 100.0, " %"),
)
_TRACE_S: Final = 30.0  # of the run in the trace; more in a fast film
_TRACE_FILM_S: Final = 6.0  # ... for as long as this in the film


@dataclass(frozen=True, slots=True)
class Scales:
    """Scales of bars and trace, common to all runs of a film."""

    error_m: float  # at the end of the error bars
    trace_m: float  # at the upper end of the trace

    @classmethod
    def of(cls, replays: Sequence[Replay]) -> Self:
        """Return the scales of runs."""
        worst = max(
            float(np.nanmax(getattr(replay.errors, body).euclidean_m, initial=0.0))
            for replay in replays
            for body in BODIES
        )
        error_m = max(0.1 * math.ceil(10.0 * worst), _MIN_FULL_ERROR_M)
        return cls(error_m, trace_scale_m(replays))


class Overlay:
    """Overlay of the pictures of one run.

    Args:
        replay: the run.
        shot: settings of the film.
        scales: of bars and trace.
        ghosts: in the picture.
        moving: whether it is a film, not a still.
        brief: leave out the legend, for a narrow picture.
    """

    def __init__(
        self,
        replay: Replay,
        shot: Shot,
        scales: Scales,
        ghosts: Sequence[Ghost] = (),
        *,
        moving: bool = True,
        brief: bool = False,
    ) -> None:
        self._replay, self._size, self._brief = replay, shot.size, brief
        self._speed = shot.speed if moving else 0.0
        self._ghosts, self._factor = ghosts, shot.look.exaggeration
        width, height = shot.size
        self.scale = max(min(height / 720.0, width / (860.0 if brief else 1280.0)), 0.3)
        self._full_error_m = scales.error_m
        window_s = max(_TRACE_S, _TRACE_FILM_S * self._speed)
        self._trace = ErrorTrace(replay, window_s, scales.trace_m, narrow=brief)

    def draw_onto(self, picture: Image.Image, time_s: float) -> None:
        """Draw the overlay of a time onto a picture, in place."""
        width, height = self._size
        margin = _MARGIN * self.scale
        self._headline(self._replay.title).paste_onto(picture, margin, margin)
        clock = self._clock(time_s)
        clock.paste_onto(picture, width - margin - clock.image.width, margin)
        faults = self._faults(time_s)
        if faults is not None:
            faults.paste_onto(picture, margin, clock.image.height + 1.5 * margin)
        bars = self._bars(time_s)
        bottom = height - margin
        bars.paste_onto(picture, margin, bottom - bars.image.height)
        trace = self._trace.box(time_s, self.scale)
        left, right = 2.0 * margin + bars.image.width, width - margin
        if not self._brief:
            legend = self._legend()
            right -= legend.image.width + margin
            legend.paste_onto(picture, right + margin, bottom - legend.image.height)
        if left + trace.image.width <= right + 1.0:
            x = 0.5 * (left + right - trace.image.width)
            trace.paste_onto(picture, x, bottom - trace.image.height)
        tilt = self._tilt(time_s)
        boxes = clock.image.width + tilt.image.width
        tilt.paste_onto(picture, width - 1.5 * margin - boxes, margin)
        caption = self._caption(time_s)
        if caption is not None:
            x = 0.5 * (width - caption.image.width)
            caption.paste_onto(picture, x, clock.image.height + 2.0 * margin)

    def _clock(self, time_s: float) -> OverlayBox:
        speed = self._replay.value(STATE, "v_mps", time_s)
        film_speed = f"  {self._speed:g}x" if self._speed else ""
        return self._headline(f"{time_s:6.1f} s   {speed:4.2f} m/s{film_speed}")

    def _tilt(self, time_s: float) -> OverlayBox:
        """Return an artificial horizon: the tilt of the tractor, for the camera stays upright."""
        roll, pitch = (
            math.degrees(self._replay.value(STATE, f"{name}_t_rad", time_s))
            for name in ("roll", "pitch")
        )
        box = OverlayBox(216.0, 34.0, self.scale)
        x, y, half = 34.0, 17.0, 22.0
        # a positive roll lifts the left side, which is left in the picture of who sits in it
        rise = half * math.sin(math.radians(roll))
        run = half * math.cos(math.radians(roll))
        box.line([(x - half, y), (x + half, y)], FAINT, 1.0)
        box.line([(x - run, y - rise), (x + run, y + rise)], INK, 3.0)
        box.text(66.0, y, f"roll {roll:+.1f}°  pitch {-pitch:+.1f}°", points=12)
        return box

    def _faults(self, time_s: float) -> OverlayBox | None:
        """Return the names of the faults that act, None without any."""
        spans = fault_spans(self._replay.record.events)
        names = [span.name for span in spans if span.start_s <= time_s < span.end_s]
        return self._headline(f"fault: {', '.join(names)}", ALARM) if names else None

    def _headline(self, text: str, colour: Rgb = INK) -> OverlayBox:
        box = OverlayBox(24.0 + text_length(text, 15, bold=True), 34.0, self.scale)
        box.text(12.0, 17.0, text, points=15, bold=True, colour=colour)
        return box

    def _bars(self, time_s: float) -> OverlayBox:
        box = OverlayBox(392.0, 136.0, self.scale)
        errors = self._replay.errors
        row = newest_row(errors.time_s, time_s)
        for y, name, error, colour in (
            (18.0, "tractor error", errors.tractor, TRACTOR),
            (42.0, "trailer error", errors.trailer, TRAILER),
        ):
            self._error_bar(box, y, name, error, row, colour)
        for y, item in zip((70.0, 94.0, 118.0), _INPUTS, strict=True):
            self._input_bar(box, y, item, time_s)
        return box

    def _error_bar(
        self, box: OverlayBox, y: float, name: str, error: BodyError, row: int, colour: Rgb
    ) -> None:
        error_m = float(error.euclidean_m[row])
        box.text(12.0, y, name)
        box.bar((136.0, y - 6, 296.0, y + 6), error_m / self._full_error_m, brighter(colour))
        box.text(380.0, y, f"{100 * error_m:.1f} cm", align="right")

    def _input_bar(
        self, box: OverlayBox, y: float, item: tuple[str, str, float, str], time_s: float
    ) -> None:
        field, label, factor, unit = item
        table = self._replay.record[CONTROL]
        row = newest_row(table.time_s, time_s)
        low, high, sent, limited = (
            float(table[f"{field}_{part}"][row]) for part in ("min", "max", "command", "limited")
        )
        span = high - low
        colour = ALARM if limited else INK
        box.text(12.0, y, label)
        box.bar((136.0, y - 6, 296.0, y + 6), (sent - low) / span, colour, zero=-low / span)
        box.text(380.0, y, f"{factor * sent:.1f}{unit}", align="right", colour=colour)

    def _legend(self) -> OverlayBox:
        error = f", error x{self._factor:g}" if self._factor != 1.0 else ""
        lines = [
            ("reference path", REFERENCE),
            (f"tractor point driven{error}", brighter(TRACTOR)),
            (f"trailer point driven{error}", brighter(TRAILER)),
            ("poles: where they should be", None),
            ("predicted path", PLAN),
            *((f"ghost: {ghost.name}", ghost.colour) for ghost in self._ghosts),
        ]
        box = OverlayBox(254.0, 32.0 + _LINE * len(lines), self.scale)
        for number, (name, colour) in enumerate(lines):
            y = 16.0 + _LINE * number
            if colour is None:
                box.rectangle(19.0, y - 7, 22.0, y + 7, brighter(TRACTOR))
                box.rectangle(26.0, y - 7, 29.0, y + 7, brighter(TRAILER))
            else:
                box.rectangle(12.0, y - 2, 36.0, y + 2, colour)
            box.text(46.0, y, name, points=13)
        y = 16.0 + _LINE * len(lines)
        box.text(12.0, y, "slip 0", points=13)
        for step in range(30):
            x = 62.0 + 4.0 * step
            box.rectangle(x, y - 6.0, x + 4.0, y + 6.0, slip_colour(FULL_SLIP * step / 29.0))
        box.text(190.0, y, f"{100 * FULL_SLIP:.0f} %", points=13)
        return box

    def _caption(self, time_s: float) -> OverlayBox | None:
        """Return the newest event if it is recent, else None."""
        shown_s = _CAPTION_S * max(self._speed, 1.0)
        recent = [e for e in self._replay.record.events if 0 <= time_s - e.time_s < shown_s]
        if not recent:
            return None
        event = recent[-1]
        lines = textwrap.wrap(event.text, 72)[:3]
        width = 32.0 + max(text_length(line, 15) for line in lines)
        box = OverlayBox(width, 14.0 + 22.0 * len(lines), self.scale)
        colour = {"info": INK, "warning": PLAN, "error": ALARM}.get(event.level, FAINT)
        for k, line in enumerate(lines):
            y = 18.0 + 22.0 * k
            box.text(0.5 * width, y, line, points=15, colour=colour, align="middle")
        return box
