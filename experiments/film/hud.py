"""Overlay of a picture: run, time, speed, errors, inputs, legend, events."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Final

import numpy as np
from PIL import Image

from proving_ground.testbed.recording.channels import CONTROL, STATE
from proving_ground.testbed.recording.record import fault_spans

from ..results.tracking_errors import BODIES, BodyError
from .colours import (
    ALARM,
    FAINT,
    FULL_SLIP,
    INK,
    PLAN,
    REFERENCE,
    TRACTOR,
    TRAILER,
    Rgb,
    slip_colour,
)
from .overlay_box import OverlayBox, text_length
from .replay import Replay, newest_row

_MARGIN: Final = 14.0
_MIN_FULL_ERROR_M: Final = 0.4  # smallest error at the end of an error bar
_CAPTION_S: Final = 3.0  # film time for which an event is shown
_INPUTS: Final = (  # field, label, factor to the unit shown, unit
    ("delta_t_rad", "front steering", math.degrees(1.0), "°"),
    ("delta_i_rad", "trailer steering", math.degrees(1.0), "°"),
    ("hp", "hydrostat", 100.0, " %"),
)
_LIGHTENING: Final = 0.45  # of a line's colour on the dark background


def error_scale(replays: Sequence[Replay]) -> float:
    """Return the error [m] at the end of the error bars, common to all runs."""
    worst = max(
        float(np.nanmax(getattr(replay.errors, body).euclidean_m, initial=0.0))
        for replay in replays
        for body in BODIES
    )
    return max(0.1 * math.ceil(10.0 * worst), _MIN_FULL_ERROR_M)


class Overlay:
    """Overlay of the pictures of one run.

    Args:
        replay: the run.
        size: of a picture [pixels].
        speed: of the film; 0 for a still.
        full_error_m: error at the end of an error bar, see `error_scale`.
        brief: leave out the legend, for a narrow picture.
    """

    def __init__(
        self,
        replay: Replay,
        size: tuple[int, int],
        speed: float,
        full_error_m: float,
        *,
        brief: bool = False,
    ) -> None:
        self._replay, self._size, self._speed, self._brief = replay, size, speed, brief
        self.scale = max(min(size[1] / 720.0, size[0] / (860.0 if brief else 1280.0)), 0.3)
        self._full_error_m = full_error_m

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
        bars.paste_onto(picture, margin, height - margin - bars.image.height)
        if not self._brief:
            legend = self._legend()
            x, y = width - margin - legend.image.width, height - margin - legend.image.height
            legend.paste_onto(picture, x, y)
        caption = self._caption(time_s)
        if caption is not None:
            x = 0.5 * (width - caption.image.width)
            caption.paste_onto(picture, x, clock.image.height + 2.0 * margin)

    def _clock(self, time_s: float) -> OverlayBox:
        speed = self._replay.value(STATE, "v_mps", time_s)
        film_speed = f"  {self._speed:g}x" if self._speed else ""
        return self._headline(f"{time_s:6.1f} s   {speed:4.2f} m/s{film_speed}")

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
        box.bar((136.0, y - 6, 296.0, y + 6), error_m / self._full_error_m, _lighter(colour))
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
        box = OverlayBox(254.0, 136.0, self.scale)
        for y, name, colour in (
            (18.0, "reference path", REFERENCE),
            (42.0, "tractor: driven, desired (mark)", _lighter(TRACTOR)),
            (66.0, "trailer: driven, desired (mark)", _lighter(TRAILER)),
            (90.0, "predicted", PLAN),
        ):
            box.rectangle(12.0, y - 2, 36.0, y + 2, colour)
            box.text(46.0, y, name, points=13)
        box.text(12.0, 116.0, "slip 0", points=13)
        for step in range(30):
            x = 62.0 + 4.0 * step
            box.rectangle(x, 110.0, x + 4.0, 122.0, slip_colour(FULL_SLIP * step / 29.0))
        box.text(190.0, 116.0, f"{100 * FULL_SLIP:.0f} %", points=13)
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


def _lighter(colour: Rgb) -> Rgb:
    red, green, blue = (round(part + _LIGHTENING * (255 - part)) for part in colour)
    return red, green, blue
