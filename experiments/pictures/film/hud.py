"""Head-up display: headline, tilt and events over a picture, figures and legend in a band below."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from PIL import Image

from ....testbed.recording.channels import CONTROL, STATE
from ....testbed.recording.record import fault_spans
from .drawing import (
    ALARM,
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
_LEAST_WIDTH: Final = 860.0  # pixels; texts and boxes of a narrower frame are smaller
_BARS_CM: Final = (5.0, 10.0, 20.0, 40.0, 80.0, 150.0, 300.0, 1000.0)  # ends of the error scale
_INPUTS: Final = (  # field, label, factor to the unit shown, unit
    ("delta_t_rad", "front steering", math.degrees(1.0), "°"),
    ("delta_i_rad", "trailer steering", math.degrees(1.0), "°"),
    ("hp", "hydrostat", 100.0, " %"),
)


@dataclass(frozen=True)
class Hud:
    """Head-up display of the pictures of one run.

    It covers the sky, and otherwise lies in a band below the picture: nothing hides the paths.
    """

    playback: Playback
    size: tuple[int, int]  # of the frame, the band included [pixels]
    speed: float = 0.0  # seconds of the run per second of film, 0 in a still
    ghosts: Sequence[Ghost] = ()

    @cached_property
    def error_m(self) -> float:
        """Cross-track error at the end of bars [m]."""
        errors = (error.cross_m for error in self.playback.errors.by_point.values())
        most_cm = max(100.0 * float(np.nanmax(np.abs(error), initial=0.0)) for error in errors)
        return 0.01 * next((step for step in _BARS_CM if step >= most_cm), _BARS_CM[-1])

    @property
    def scale(self) -> float:
        """Pixels per unit of length, 1 in a frame of 1280 x 720."""
        width, height = self.size
        return max(min(height / 720.0, width / _LEAST_WIDTH), 0.2)

    @property
    def view_size(self) -> tuple[int, int]:
        """Width and height of the picture above the band [pixels]."""
        width, height = self.size
        return width, height - round((_BOX + 2.0 * _MARGIN) * self.scale)

    def draw_onto(self, picture: Image.Image, time_s: float) -> None:
        """Draw the display of a time onto a frame, in place."""
        width, height = self.size
        margin = _MARGIN * self.scale
        spans = fault_spans(self.playback.record.events)
        acting = [span.name for span in spans if span.start_s <= time_s < span.end_s]
        boxes = [
            (self._headline(self._clock(time_s)), 1, 0),
            (self._bars(time_s), 0, 1),
            (self._legend(), 1, 1),
            (self._headline(self.playback.title), 0, 0),
        ]
        for box, right, low in boxes:
            x = width - margin - box.image.width if right else margin
            box.paste_onto(picture, x, height - margin - box.image.height if low else margin)
        if acting:
            alarm = self._headline(f"fault: {', '.join(acting)}", ALARM)
            alarm.paste_onto(picture, margin, alarm.image.height + 1.5 * margin)

    def _headline(self, text: str, colour: Rgb = INK) -> OverlayBox:
        box = OverlayBox(24.0 + text_length(text, 15, bold=True), 34.0, self.scale)
        box.text(12.0, 17.0, text, points=15, bold=True, colour=colour)
        return box

    def _clock(self, time_s: float) -> str:
        """Return time, speed and the tilt of the tractor, for the camera stays upright."""
        speed, roll, pitch = (
            self.playback.value(STATE, name, time_s)
            for name in ("v_mps", "roll_t_rad", "pitch_t_rad")
        )
        tilt = f"roll {math.degrees(roll):+.1f}°  pitch {-math.degrees(pitch):+.1f}°"
        film_speed = f"   {self.speed:g}x" if self.speed else ""
        return f"{tilt}   {time_s:6.1f} s   {speed:4.2f} m/s{film_speed}"

    def _bars(self, time_s: float) -> OverlayBox:
        """Return the cross-track errors and the inputs as bars."""
        box = OverlayBox(392.0, _BOX, self.scale)
        errors = self.playback.errors
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
            share = (sent - low) / (high - low)
            zero = -low / (high - low)
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

    def _legend(self) -> OverlayBox:
        """Return the names of what is drawn, and the colours of slip."""
        lines: list[tuple[str, Rgb | None]] = [
            ("reference path", REFERENCE),
            ("tractor driven", POINTS["tractor"]),
            ("trailer driven", POINTS["trailer"]),
            ("reference points", None),
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
