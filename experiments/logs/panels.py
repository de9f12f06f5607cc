"""Plots of a run that the layouts for Foxglove, PlotJuggler and Rerun share."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from ...testbed.recording import topics
from ...testbed.recording.channels import (
    CONTROL,
    ERROR,
    SOLVER,
    STATE,
    TIMING,
    TRACKING,
    TYRES,
    Channel,
)
from ...testbed.truth import WHEELS
from ..colours import (
    BLUE,
    BODY_COLOURS,
    BOUND,
    ORANGE,
    PREDICTED,
    RED,
    REFERENCE,
    SERIES_COLOURS,
    SKY,
)

PATH_COLOURS: Final = {
    topics.REFERENCE_PATH_TOPIC: REFERENCE,
    topics.DRIVEN_TOPIC: BODY_COLOURS["tractor"],
    topics.DRIVEN_TRAILER_TOPIC: BODY_COLOURS["trailer"],
    topics.PREDICTED_PATH_TOPIC: PREDICTED,
    topics.PREDICTED_TRAILER_PATH_TOPIC: PREDICTED,
}
"""Colours of the paths on the ground by topic."""


@dataclass(frozen=True, slots=True)
class Series:
    """A field of a channel and its colour."""

    channel: Channel
    field: str
    colour: str


@dataclass(frozen=True, slots=True)
class Panel:
    """A plot over time."""

    name: str  # a short word, unique
    title: str
    series: tuple[Series, ...]


def _panel(name: str, title: str, channel: Channel, fields: dict[str, str]) -> Panel:
    return Panel(name, title, tuple(Series(channel, *item) for item in fields.items()))


def _points(form: str) -> dict[str, str]:
    return {form.format(body): BODY_COLOURS[body] for body in ("tractor", "trailer")}


def _in_turn(*fields: str) -> dict[str, str]:
    return dict(zip(fields, SERIES_COLOURS, strict=False))


def _input(name: str, title: str, field: str) -> Panel:
    parts = ("feedforward", "feedback", "robust", "command", "min", "max")
    colours = (SKY, RED, BLUE, ORANGE, BOUND, BOUND)
    fields = {f"{field}_{part}": colour for part, colour in zip(parts, colours, strict=True)}
    return _panel(name, title, CONTROL, fields)


PANELS: Final = (
    _panel("cross", "True cross-track error [m]", ERROR, _points("{}_cross_m")),
    _panel("error", "True distance to the reference [m]", ERROR, _points("{}_euclidean_m")),
    _input("front", "Front steering [rad]", "delta_t_rad"),
    _input("trailer", "Trailer steering [rad]", "delta_i_rad"),
    _input("hydrostat", "Hydrostat [fraction]", "hp"),
    _panel("slip", "Slip", TYRES, _in_turn(*(f"{wheel}_slip" for wheel in WHEELS))),
    _panel(
        "estimated",
        "Estimated error [m]",
        TRACKING,
        _in_turn("x_t_e_m", "y_t_e_m", "x_i_e_m", "y_i_e_m"),
    ),
    _panel("load", "Load [N]", TYRES, _in_turn(*(f"{wheel}_load_n" for wheel in WHEELS))),
    _panel("speed", "Speed [m/s]", STATE, _in_turn("v_mps", "v_rim_mps")),
    _panel("solver", "QP", SOLVER, _in_turn("iterations", "accepted", "fallback")),
    _panel("cost", "Cost [us]", TIMING, _in_turn(*TIMING.fields)),
)
"""In the order of their importance."""
