"""Ablation of `ttempc`: feedforward, MPC, disturbance estimate, robust law, tube."""

from __future__ import annotations

import json
import math
from typing import Final

import pandas as pd

from ...seeds import report_seeds
from ..study import Study
from ..tables import grouped, label, lost, mean, mean_errors


def _variant(**options: object) -> tuple[str, ...]:
    """Return overrides of a scenario that set options of `ttempc`."""
    return tuple(f"controller.options.{key}={json.dumps(value)}" for key, value in options.items())


SCENARIOS: Final = ("grass", "wet-slope", "patchy", "old-valves")
"""Those on which the parts differ most."""

PARTS: Final = {
    "feedforward": ('controller.name="feedforward"',),
    "+ LMPC": _variant(robust=False, disturbances=False),
    "+ LMPC, robust": _variant(disturbances=False, tightening="none"),
    "+ LMPC, disturbance (`ttempc-nominal`)": _variant(robust=False),
    "+ LMPC, disturbance, robust": _variant(tightening="none"),
    "+ LMPC, disturbance, robust, growing tube (`ttempc`)": _variant(),
    "no tube, MPC tightened by the law's authority": _variant(tightening="saturation"),
    "no tube, robust in the tube reading": _variant(tightening="none", nominal="tube"),
    "no robust, step weights 1, 1, 0.02": _variant(robust=False, step_weight=(1.0, 1.0, 0.02)),
    "no robust, step weights 0.05, 0.05, 0.1": _variant(
        robust=False, step_weight=(0.05, 0.05, 0.1)
    ),
    "no robust, horizon 12": _variant(robust=False, horizon=12),
}


def _table(frame: pd.DataFrame) -> str:
    cells = {
        "scenario": label("scenario", "`{}`"),
        "parts": label("parts"),
        **mean_errors(),
        "steering rate, deg/s": mean("inputs.delta_t.rms_rate", ".1f", math.degrees(1.0)),
        "lost": lost,
    }
    return grouped(frame, ("scenario", "parts"), cells)


STUDIES: Final = (
    Study(
        name="ablation",
        page="docs/ablation.md",
        table=_table,
        scenarios=SCENARIOS,
        axes={"parts": PARTS},
        seeds=report_seeds(2),
        checks=(
            *((name, "ttempc") for name in SCENARIOS),
            ("grass", "ttempc-nominal"),
            ("grass", "feedforward"),
        ),
        minutes=2.0,
    ),
)
