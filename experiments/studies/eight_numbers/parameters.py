"""Parameters of the search, their bounds, and the overrides of a scenario that set them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, Literal

from ttempc.types import FloatArray
from ttempc.vehicle import Vehicle

LMPC: Final = ('controller.name="paper"',)
NMPC: Final = ('controller.name="kayacan-nmpc"', 'controller.estimator="kayacan-nmhe"')


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number within bounds, or one of a few choices.

    `low` and `high` are the first and the last place of `choices`, where there are any.
    """

    name: str
    low: float
    high: float
    overrides: Callable[[float | str], tuple[str, ...]]  # of the value
    scale: Literal["linear", "log"] = "linear"
    choices: tuple[str, ...] = ()

    @classmethod
    def choice(
        cls, name: str, overrides: Callable[[float | str], tuple[str, ...]], *choices: str
    ) -> Parameter:
        """Return a parameter with a few values."""
        return cls(name, 0.0, len(choices) - 1.0, overrides, choices=choices)

    def value(self, share: float) -> float | str:
        """Return the value at a share of the way from the lower to the upper bound."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.scale == "log":
            exact = self.low * (self.high / self.low) ** share
        else:
            exact = self.low + share * (self.high - self.low)
        return float(f"{exact:.3g}")

    def share(self, value: float | str) -> float:
        """Return a share that `value` turns into `value`, to three digits."""
        if self.choices:
            return (self.choices.index(str(value)) + 0.5) / len(self.choices)
        if self.scale == "log":
            return math.log(float(value) / self.low) / math.log(self.high / self.low)
        return (float(value) - self.low) / (self.high - self.low)

    @property
    def bounds(self) -> str:
        """Bounds or choices as text."""
        if self.choices:
            return ", ".join(self.choices)
        return f"{self.low:g} to {self.high:g}" + (" (log)" if self.scale == "log" else "")


def _key(*keys: str) -> Callable[[float | str], tuple[str, ...]]:
    """Return the overrides that give the value to all `keys`."""

    def overrides(value: float | str) -> tuple[str, ...]:
        text = f'"{value}"' if isinstance(value, str) else f"{value}"
        return tuple(f"{key}={text}" for key in keys)

    return overrides


def _dead_time(value: float | str) -> tuple[str, ...]:
    """Return the dead time of both steering valves, a whole number of physics steps."""
    rounded = round(float(value), 2)
    return _key("actuators.front.dead_time_s", "actuators.trailer.dead_time_s")(rounded)


def _hitch(value: float | str) -> tuple[str, ...]:
    """Return the place of RJ1 between rear axle and RJ2, whose distance is printed."""
    offset, whole = float(value), Vehicle().drawbar_offset
    lengths = _key("plant.vehicle.hitch_offset_m", "controller.vehicle.hitch_offset_m")(offset)
    drawbar = round(whole - offset, 4)
    lengths += _key("plant.vehicle.drawbar_m", "controller.vehicle.drawbar_m")(drawbar)
    # Nearer to the axle, the drawbar meets the wheels at a smaller angle than the file's.
    limit = _key("plant.vehicle.parts.hitch.yaw_limit_deg")(60.0) if offset < 0.3 else ()
    return (*lengths, *limit)


def _option(name: str) -> Callable[[float | str], tuple[str, ...]]:
    return _key(f"controller.options.{name}")


FIELD: Final = (
    Parameter.choice("ISO 8608 class", _key("terrain.iso_class"), "C", "D", "E", "F"),
    Parameter("cone index [kPa]", 120.0, 600.0, _key("soil.cone_index_kpa"), "log"),
    Parameter("slope [rad]", 0.0, 0.10, _key("terrain.slope_rad")),
)
"""The ground."""

MACHINE: Final = (
    *FIELD,
    Parameter("distance of the circles' centres [m]", 24.0, 44.0, _key("path.centre_distance_m")),
    Parameter("white share of the GNSS error", 0.0, 1.0, _key("sensors.gnss_white_share")),
    Parameter.choice("GNSS antenna", _key("sensors.gnss_antenna"), "point", "raw"),
    Parameter("dead time of both valves [s]", 0.01, 0.4, _dead_time, "log"),
    Parameter("rear axle to RJ1 [m]", 0.2, 0.6, _hitch),
    Parameter(
        "stop of the trailer steering [deg]",
        20.0,
        35.0,
        _key(
            "plant.vehicle.parts.trailer_steering.limit_deg", "controller.vehicle.trailer_limit_deg"
        ),
    ),
)
"""Ground, path, sensors, actuators and vehicle: all that both controllers share.

Of the path the radius alone is printed; the length of its straights follows from the distance.
"""

CORRELATED: Final = ('sensors.gnss_error="correlated"',)
"""Kind of GNSS error of all sets; a white share of 1 makes it white."""

LMPC_OPTIONS: Final = (
    Parameter.choice("nominal state of the LMPC", _option("nominal"), "one-step", "tube"),
)
"""Options of `paper` that are not printed."""


def _bounds(front_deg: float, trailer_deg: float) -> str:
    radians = f"{math.radians(front_deg):.4f}, {math.radians(trailer_deg):.4f}, 1.0"
    return f"controller.options.input_bound=[{radians}]"


def _step_weight(value: float | str) -> tuple[str, ...]:
    return (f"controller.options.step_weight=[{value}, {value}, 1.0]",)


def _speed_weight(value: float | str) -> tuple[str, ...]:
    return (f"controller.options.output_weight=[1.0, 1.0, 1.0, 1.0, {value}]",)


# Both are one option: `overrides` writes it.
_FRONT = Parameter(
    "bound of the front steering of the NMPC [deg]", 8.0, 35.0, lambda value: (), "log"
)
_TRAILER = Parameter(
    "bound of the trailer steering of the NMPC [deg]", 3.0, 25.0, lambda value: (), "log"
)

NMPC_OPTIONS: Final = (
    _FRONT,
    _TRAILER,
    Parameter("look-ahead of the NMPC [m]", 0.0, 4.0, _option("look_ahead_m")),
    Parameter.choice("target of the NMPC", _option("target"), "fixed", "moving"),
    Parameter("step weight of both steerings of the NMPC", 0.1, 100.0, _step_weight, "log"),
    Parameter("speed weight of the NMPC", 0.1, 100.0, _speed_weight, "log"),
    Parameter.choice("trailer input of the NMPC", _option("trailer_input"), "lambda", "delta_i"),
)
"""Options of `kayacan-nmpc` that are not known."""

ALL: Final = (*MACHINE, *LMPC_OPTIONS, *NMPC_OPTIONS)

BY_HAND: Final[dict[str, float | str]] = {
    "ISO 8608 class": "E",
    "cone index [kPa]": 160.0,
    "slope [rad]": 0.02,
    "distance of the circles' centres [m]": 44.0,
    "white share of the GNSS error": 1.0,
    "GNSS antenna": "point",
    "dead time of both valves [s]": 0.01,
    "rear axle to RJ1 [m]": 0.3,
    "stop of the trailer steering [deg]": 25.0,
    "nominal state of the LMPC": "one-step",
    "bound of the front steering of the NMPC [deg]": 10.5,
    "bound of the trailer steering of the NMPC [deg]": 6.0,
    "look-ahead of the NMPC [m]": 1.6,
    "target of the NMPC": "fixed",
    "step weight of both steerings of the NMPC": 1.0,
    "speed weight of the NMPC": 1.0,
    "trailer input of the NMPC": "lambda",
}
"""First point of the search: the defaults, with three values found by hand on seeds 1 and 2.

These are the bounds of both steerings of the NMPC and the distance of the centres.
"""


def overrides(parameters: Sequence[Parameter], shares: FloatArray) -> tuple[str, ...]:
    """Return the overrides that set `parameters` to their values at `shares` (n,)."""
    values = [item.value(share) for item, share in zip(parameters, shares.tolist(), strict=True)]
    lines = [
        line
        for item, value in zip(parameters, values, strict=True)
        for line in item.overrides(value)
    ]
    if _FRONT in parameters:
        front, trailer = (float(values[parameters.index(item)]) for item in (_FRONT, _TRAILER))
        lines.append(_bounds(front, trailer))
    return tuple(lines)
