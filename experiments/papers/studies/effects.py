"""Effects of machine, soil and tyres on the error on `farm`, on and off in pairs."""

import math
from typing import Final

import numpy as np
import pandas as pd

from ...results.statistics import mean
from ..markdown import markdown
from ..table import Table, listed, study, variants

BASE: Final = (
    'implement={type="field-cultivator",width_m=2.0,depth_m=0.10}',
    "actuators.front.flow_right=1.0",
    "actuators.trailer.flow_right=1.0",
)
_AXES: Final = ("front", "trailer")
_SOIL: Final = "soil.random={coefficient_of_variation=0.3,correlation_m=5.0}"
EFFECTS: Final[dict[str, tuple[str, ...]]] = {
    "none": (),
    "single-rod cylinders, `flow_right` 0.69": tuple(
        f"actuators.{axis}.flow_right=0.69" for axis in _AXES
    ),
    "cold oil, both flows 0.6": tuple(
        f"actuators.{axis}.flow_{side}=0.6" for axis in _AXES for side in ("left", "right")
    ),
    "play of both steerings, 1 deg": tuple(f"actuators.{axis}.backlash_deg=1.0" for axis in _AXES),
    "`soil.random`, cv 0.3": (_SOIL,),
    "`soil.random` and draft that follows it": (_SOIL, "implement.strength_exponent=0.5"),
    "no side force of the tool": ("implement.side_stiffness_n_per_deg_m2=0.0",),
    "no relaxation length": ("plant.wheel_law.relaxation_lat_m=0.001",),
    "`soil.ruts`": ("soil.ruts=true",),
}
"""Overrides of each effect beside `BASE`."""

_CONTROLLERS: Final = ("ttempc", "nmpc-rti", "lqr", "pid")
_P95: Final = "tracking.all.tool.cross_p95_m"
_EQUAL: Final = 0.05  # [cm]


def _table(frame: pd.DataFrame) -> str:
    """Return the change of the tool's p95 by each effect [cm], and the order of controllers.

    Means of pairs with the half width of their 95 % interval. A controller that lost a run has the
    number of lost runs instead, and is last. Controllers within `_EQUAL` of each other are equal.
    """
    cm = (100.0 * frame[_P95]).where(frame["status"] == "completed")
    errors = frame.assign(cm=cm).pivot(index="seed", columns=["effect", "controller"], values="cm")
    lines = []
    for effect in EFFECTS:
        own = errors[effect]
        cells = []
        for driver in _CONTROLLERS:
            change = (own[driver] - errors["none"][driver]).to_numpy()
            if np.isnan(change).any():
                cells.append(f"{np.isnan(change).sum()} of {len(own)} lost")
            elif effect == "none":
                cells.append(f"{own[driver].mean():.2f}")
            else:
                found = mean(change)
                cells.append(f"{found.value:+.2f} ± {found.value - (found.low or 0.0):.2f}")
        means = {c: own[c].mean() if own[c].notna().all() else math.inf for c in _CONTROLLERS}
        order = ""
        least = -math.inf
        for name, value in sorted(means.items(), key=lambda item: item[1]):
            order += (" = " if value - least < _EQUAL or value == least else " < ") * bool(order)
            least = least if order.endswith("= ") else value
            order += f"`{name}`"
        lines.append([effect, *cells, order])
    return markdown(["effect", *(f"`{name}`" for name in _CONTROLLERS), "order"], lines)


TABLES: Final = (
    Table(
        name="effects",
        studies={
            "effects": study(
                "farm",
                range(9701, 9709),
                ("path.laps=1", *BASE),
                variants("effect", EFFECTS),
                listed("controller", *_CONTROLLERS),
            )
        },
        text=_table,
        checks=(("farm", "ttempc", *BASE),),
    ),
)
