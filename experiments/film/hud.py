"""What is written over a picture: run, time, speed, errors, inputs, slip, events."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Sequence
from typing import Final

import numpy as np
from PIL import Image

from proving_ground.testbed.recording.channels import CONTROL, STATE

from ..results.tracking import BODIES, BodyError
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
from .panel import Panel, Side, font
from .replay import Replay, newest

_MARGIN: Final = 14.0
_LEAST_ERROR_M: Final = 0.4  # at the end of an error bar
_CAPTION_S: Final = 3.0  # of film for which an event stands
_INPUTS: Final = (  # field, label, factor to the unit shown, unit
    ("delta_t_rad", "front steering", math.degrees(1.0), "°"),
    ("delta_i_rad", "trailer steering", math.degrees(1.0), "°"),
    ("hp", "hydrostat", 100.0, " %"),
)
_BRIGHT: Final = 0.45  # how much lighter a line's colour is on a dark plate


def error_scale(replays: Sequence[Replay]) -> float:
    """Return a length [m] that all errors of some runs fit into, the same for all of them."""
    worst = max(
        float(np.nanmax(getattr(replay.errors, body).euclidean_m, initial=0.0))
        for replay in replays
        for body in BODIES
    )
    return max(0.1 * math.ceil(10.0 * worst), _LEAST_ERROR_M)


class Overlay:
    """Writes over the pictures of one run.

    Args:
        replay: the run.
        size: of a picture [pixels].
        speed: of the film; 0 for a still.
        full_error_m: at the end of an error bar, as of `error_scale`.
        brief: leave out the legend, as in a narrow picture.
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

    def onto(self, picture: Image.Image, time_s: float) -> None:
        """Write what holds at a moment onto a picture, in place."""
        width, height = self._size
        margin = _MARGIN * self.scale
        self._title().onto(picture, margin, margin)
        clock = self._clock(time_s)
        clock.onto(picture, width - margin - clock.image.width, margin)
        bars = self._bars(time_s)
        bars.onto(picture, margin, height - margin - bars.image.height)
        if not self._brief:
            legend = self._legend()
            x, y = width - margin - legend.image.width, height - margin - legend.image.height
            legend.onto(picture, x, y)
        caption = self._caption(time_s)
        if caption is not None:
            x = 0.5 * (width - caption.image.width)
            caption.onto(picture, x, clock.image.height + 2.0 * margin)

    def _title(self) -> Panel:
        words = self._replay.title
        panel = Panel(24.0 + _length(words, 15, bold=True), 34.0, self.scale)
        panel.text(12.0, 17.0, words, points=15, bold=True)
        return panel

    def _clock(self, time_s: float) -> Panel:
        speed = self._replay.value(STATE, "v_mps", time_s)
        pace = f"  {self._speed:g}x" if self._speed else ""
        words = f"{time_s:6.1f} s   {speed:4.2f} m/s{pace}"
        panel = Panel(24.0 + _length(words, 15, bold=True), 34.0, self.scale)
        panel.text(12.0, 17.0, words, points=15, bold=True)
        return panel

    def _bars(self, time_s: float) -> Panel:
        panel = Panel(392.0, 136.0, self.scale)
        errors = self._replay.errors
        row = max(int(np.searchsorted(errors.time_s, time_s + 1e-9)) - 1, 0)
        for y, name, error, colour in (
            (18.0, "tractor error", errors.tractor, TRACTOR),
            (42.0, "trailer error", errors.trailer, TRAILER),
        ):
            self._error_bar(panel, y, name, error, row, colour)
        for y, item in zip((70.0, 94.0, 118.0), _INPUTS, strict=True):
            self._input_bar(panel, y, item, time_s)
        return panel

    def _error_bar(
        self, panel: Panel, y: float, name: str, error: BodyError, row: int, colour: Rgb
    ) -> None:
        here = float(error.euclidean_m[row])
        panel.text(12.0, y, name)
        panel.bar((136.0, y - 6, 296.0, y + 6), here / self._full_error_m, _lighter(colour))
        panel.text(380.0, y, f"{100 * here:.1f} cm", side="right")

    def _input_bar(
        self, panel: Panel, y: float, item: tuple[str, str, float, str], time_s: float
    ) -> None:
        field, label, factor, unit = item
        table = self._replay.record[CONTROL]
        row = newest(table, time_s)
        low, high, sent, limited = (
            float(table[f"{field}_{part}"][row]) for part in ("min", "max", "command", "limited")
        )
        span = high - low
        colour = ALARM if limited else INK
        panel.text(12.0, y, label)
        box = (136.0, y - 6, 296.0, y + 6)
        panel.bar(box, (sent - low) / span, colour, zero=-low / span)
        panel.text(380.0, y, f"{factor * sent:.1f}{unit}", side="right", colour=colour)

    def _legend(self) -> Panel:
        panel = Panel(246.0, 136.0, self.scale)
        for y, name, colour in (
            (18.0, "reference path", REFERENCE),
            (42.0, "tractor: driven, due (mark)", _lighter(TRACTOR)),
            (66.0, "trailer: driven, due (mark)", _lighter(TRAILER)),
            (90.0, "predicted", PLAN),
        ):
            panel.rectangle(12.0, y - 2, 36.0, y + 2, colour)
            panel.text(46.0, y, name, points=13)
        panel.text(12.0, 116.0, "slip 0", points=13)
        for step in range(30):
            x = 62.0 + 4.0 * step
            panel.rectangle(x, 110.0, x + 4.0, 122.0, slip_colour(FULL_SLIP * step / 29.0))
        panel.text(190.0, 116.0, f"{100 * FULL_SLIP:.0f} %", points=13)
        return panel

    def _caption(self, time_s: float) -> Panel | None:
        """Return the newest event while it stands, None else."""
        lasts = _CAPTION_S * max(self._speed, 1.0)
        standing = [e for e in self._replay.record.events if 0 <= time_s - e.time_s < lasts]
        if not standing:
            return None
        event = standing[-1]
        lines = textwrap.wrap(event.text, 72)[:3]
        width = 32.0 + max(_length(line, 15) for line in lines)
        panel = Panel(width, 14.0 + 22.0 * len(lines), self.scale)
        colour = {"info": INK, "warning": PLAN, "error": ALARM}.get(event.level, FAINT)
        middle: Side = "middle"
        for k, line in enumerate(lines):
            panel.text(0.5 * width, 18.0 + 22.0 * k, line, points=15, colour=colour, side=middle)
        return panel


def _length(words: str, points: int, *, bold: bool = False) -> float:
    return float(font(points, bold).getlength(words))


def _lighter(colour: Rgb) -> Rgb:
    red, green, blue = (round(part + _BRIGHT * (255 - part)) for part in colour)
    return red, green, blue
