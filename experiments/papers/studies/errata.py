"""Effect of each correction of the paper's equations, one at a time.

On `pavement`, where the plant is closest to the kinematic model.
"""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from ttempc.paper.composition import paper_controller
from ttempc.paper.options import PaperOptions

from ...seeds import report_seeds
from ..study import Case, Row, Study, lap
from ..tables import grouped, label, lost, mean_errors

READINGS: Final[dict[str, dict[str, Any]]] = {
    "`paper`": {},
    "1: hitch sign by geometry": {"hitch_sign": -1},
    "2: hitch angle of the reference": {"hitch_angle": "reference"},
    "3: feedforward by geometry": {"feedforward": "geometry"},
    "1 and 3": {"hitch_sign": -1, "feedforward": "geometry"},
    "1, 2 and 3": {"hitch_sign": -1, "hitch_angle": "reference", "feedforward": "geometry"},
    "4 as printed": {"trailer_error_frame": "tractor"},
    "5: exact trailer speed": {"trailer_speed": "exact"},
    "6 as printed": {"robust_sign": 1},
    "7 as printed": {"hp_full_scale": 100},
    "8: the tube's own nominal": {"nominal": "tube"},
    "6 as printed, with 8: `paper-printed-sign`": {"robust_sign": 1, "nominal": "tube"},
    "robust action off": {"robust": False},
}


def drive(case: Case) -> Row:
    """Drive a lap of `paper` with a reading."""
    return lap(case, partial(paper_controller, options=PaperOptions(**READINGS[case["reading"]])))


STUDIES: Final = (
    Study(
        name="errata",
        page="docs/errata.md",
        table=lambda frame: grouped(
            frame, ["reading"], {"reading": label("reading"), **mean_errors(".1f"), "lost": lost}
        ),
        scenarios=("pavement",),
        axes={"reading": list(READINGS)},
        seeds=report_seeds(3),
        drive=drive,
        checks=(("pavement", "paper"), ("pavement", "paper-printed-sign")),
        minutes=1.0,
    ),
)
