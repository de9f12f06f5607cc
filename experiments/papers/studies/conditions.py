"""Conditions outside the tuning of `ttempc`: speeds, radii, soft soil, rough ground."""

from __future__ import annotations

from typing import Final

from ...seeds import report_seeds
from ..study import Study
from ..tables import grouped, label, lost, mean_errors

CHANGES: Final = {
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

STUDIES: Final = (
    Study(
        name="conditions",
        page="docs/ablation.md",
        table=lambda frame: grouped(
            frame, ["change"], {"ttempc": label("change"), **mean_errors(".1f"), "lost": lost}
        ),
        axes={"change": CHANGES},
        seeds=report_seeds(2),
        checks=tuple(("grass", "ttempc", *change) for change in CHANGES.values()),
        minutes=0.5,
    ),
)
