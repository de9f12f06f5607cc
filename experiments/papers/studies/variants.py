"""Variants of a controller: readings of the paper, parts of `ttempc`."""

from __future__ import annotations

import json
import math
from typing import Final

from ...seeds import report_seeds
from ..study import Study
from ..tables import grouped, label, lost, mean, mean_errors


def _options(**options: object) -> tuple[str, ...]:
    return tuple(f"controller.options.{key}={json.dumps(value)}" for key, value in options.items())


def _named(controller: str) -> tuple[str, ...]:
    return (f'controller.name="{controller}"',)


READINGS: Final = {
    "`paper`": (),
    "1: hitch sign by geometry": _options(hitch_sign=-1),
    "2: hitch angle of the reference": _options(hitch_angle="reference"),
    "3: feedforward by geometry": _options(feedforward="geometry"),
    "1 and 3": _options(hitch_sign=-1, feedforward="geometry"),
    "1, 2 and 3": _options(hitch_sign=-1, hitch_angle="reference", feedforward="geometry"),
    "4 as printed": _options(trailer_error_frame="tractor"),
    "5: exact trailer speed": _options(trailer_speed="exact"),
    "6 as printed": _options(robust_sign=1),
    "7 as printed": _options(hp_full_scale=100),
    "8: the tube's own nominal": _options(nominal="tube"),
    "6 as printed, with 8: `paper-printed-sign`": _options(robust_sign=1, nominal="tube"),
    "robust action off": _options(robust=False),
}
"""Corrections of the paper's equations, each changed by itself, on `pavement`, where the plant is
closest to the kinematic model."""

PARTS: Final = {
    "feedforward": _named("feedforward"),
    "+ LMPC": _options(robust=False, disturbances=False),
    "+ LMPC, robust": _options(disturbances=False, tightening="none"),
    "+ LMPC, disturbance (`ttempc-nominal`)": _options(robust=False),
    "+ LMPC, disturbance, robust": _options(tightening="none"),
    "+ LMPC, disturbance, robust, growing tube (`ttempc`)": (),
    "no tube, MPC tightened by the law's authority": _options(tightening="saturation"),
    "no tube, robust in the tube reading": _options(tightening="none", nominal="tube"),
    "no robust, step weights 1, 1, 0.02": _options(robust=False, step_weight=(1.0, 1.0, 0.02)),
    "no robust, step weights 0.05, 0.05, 0.1": _options(
        robust=False, step_weight=(0.05, 0.05, 0.1)
    ),
    "no robust, horizon 12": _options(robust=False, horizon=12),
}

STUDIES: Final = (
    Study(
        name="ablation",
        scenarios=("grass", "wet-slope", "patchy", "old-valves"),  # where the parts differ most
        axes={"parts": PARTS},
        seeds=report_seeds(2),
        table=lambda runs: grouped(
            runs,
            ["scenario", "parts"],
            {
                "scenario": label("scenario", "`{}`"),
                "parts": label("parts"),
                **mean_errors(),
                "steering rate, deg/s": mean(
                    "inputs.delta_t.rms_rate", form=".1f", factor=math.degrees(1.0)
                ),
                "lost": lost,
            },
        ),
        checks=(
            *((name, "ttempc") for name in ("grass", "wet-slope", "patchy", "old-valves")),
            ("grass", "ttempc-nominal"),
            ("grass", "feedforward"),
        ),
        minutes=2.0,
    ),
    Study(
        name="errata",
        scenarios=("pavement",),
        overrides=("path.laps=1", *_named("paper")),
        axes={"reading": READINGS},
        seeds=report_seeds(3),
        table=lambda runs: grouped(
            runs, ["reading"], {"reading": label("reading"), **mean_errors(".1f"), "lost": lost}
        ),
        checks=(("pavement", "paper"), ("pavement", "paper-printed-sign")),
        minutes=1.0,
    ),
)
