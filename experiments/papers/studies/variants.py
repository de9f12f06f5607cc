"""Variants of a controller: readings of the paper, parts and weights of `ttempc`, conditions."""

from __future__ import annotations

import json
import math
from typing import Final

import pandas as pd

from ...figures import png
from ...figures.style import blank, dress, series
from ...results.summary import ACTUATOR_USE
from ...seeds import report_seeds
from ..cells import (
    POINTS,
    Cell,
    completed,
    grouped,
    groups,
    label,
    lost,
    mean,
    mean_errors,
    numbers,
)
from ..study import Block, Study


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

CONDITIONS: Final = {
    "`grass` as it is": (),
    "0.5 m/s": ("path.speed_mps=0.5",),
    "1.3 m/s": ("path.speed_mps=1.3",),
    "R = 6 m": ("path.radius_m=6.0",),
    "R = 20 m": (
        "path.radius_m=20.0",
        "path.centre_distance_m=60.0",
        "terrain.size_x_m=130.0",
        "terrain.size_y_m=70.0",
    ),
    "150 kPa": ("soil.cone_index_kpa=150.0",),
    "class F": ('terrain.iso_class="F"',),
}
"""Settings outside the tuning, one changed at a time."""

WEIGHTS: Final = {  # of the hydrostat's steps; "–": the controller has no such option
    **{("ttempc", w): (0.3, 0.1, w) for w in (0.01, 0.03, 0.1, 0.3, 1.0, 10.0)},
    **{("lqr", w): (1.0, 1.0, w) for w in (0.1, 1.0, 10.0)},
    **{(name, "–"): () for name in ("nmpc-rti", "ttempc-tube", "pid")},
}
"""Step weights of both steerings and the hydrostat, by controller and the last of them."""

_TRAVEL: Final = "inputs.hp.travel_per_m"


def _of_complete(cell: Cell) -> Cell:
    return lambda runs: cell(runs) if completed(runs) else "nan"


def _weight(runs: pd.DataFrame) -> str:
    _, weight = runs["variant"].iloc[0]
    return weight if isinstance(weight, str) else f"{weight:g}"


def front(runs: pd.DataFrame) -> Block:
    """Return error and use of the actuators by the hydrostat's weight, with a figure."""
    use = {head: mean(name, form=".1f", factor=scale) for head, name, scale in ACTUATOR_USE}
    cells = {
        "scenario": label("scenario", "`{}`"),
        "controller": label("controller", "`{}`"),
        "hydrostat weight": _weight,
        **{head: _of_complete(cell) for head, cell in {"error [cm]": mean(*POINTS), **use}.items()},
        "lost": lost,
    }
    text = grouped(runs, ["scenario", "variant"], cells)

    figure = blank(3.4)
    fields = [*groups(runs, ["scenario"])]
    panels = figure.subplots(1, len(fields), squeeze=False)[0]
    for axes, field in zip(panels, fields, strict=True):
        for number, own in enumerate(groups(field, ["controller"])):
            line = [one for one in groups(own, ["variant"]) if completed(one)]
            travel = [100.0 * numbers(one, _TRAVEL).mean() for one in line]
            name = str(own["controller"].iloc[0])
            error = [100.0 * numbers(one, *POINTS).mean() for one in line]
            axes.plot(travel, error, **series(number, name))
        title = str(field["scenario"].iloc[0])
        dress(axes, "hydrostat travel [%/m]", "mean error of both points [cm]", title)
        axes.set_xlim(left=0.0)
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), frameon=False)
    return Block(f"![Error over hydrostat travel](front.png)\n\n{text}", {"front.png": png(figure)})


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
        name="front",
        scenarios=("grass", "patchy"),
        axes={
            "variant": {
                key: (*_named(key[0]), *(_options(step_weight=steps) if steps else ()))
                for key, steps in WEIGHTS.items()
            }
        },
        seeds=report_seeds(2),
        table=front,
        checks=(
            ("grass", "ttempc"),
            ("patchy", "ttempc"),
            *(("grass", name) for name in ("pid", "lqr", "nmpc-rti", "ttempc-tube")),
        ),
        minutes=2.0,
    ),
    Study(
        name="conditions",
        axes={"condition": CONDITIONS},
        seeds=report_seeds(2),
        table=lambda runs: grouped(
            runs, ["condition"], {"ttempc": label("condition"), **mean_errors(".1f"), "lost": lost}
        ),
        checks=tuple(("grass", "ttempc", *changes) for changes in CONDITIONS.values()),
        minutes=0.5,
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
