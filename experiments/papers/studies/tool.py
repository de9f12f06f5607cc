"""The tool on `cultivate`: controllers that guide the tool or the axle, with and without IMUs."""

from typing import Final

from ..study import Study
from ..tables import grouped, label, lost, mean

_SEEDS: Final = tuple(range(9501, 9521))  # 21 to 40 were those of tuning

CONTROLLERS: Final = {
    **{
        f"`{name}`": (f'controller.name="{name}"',) for name in ("ttempc", "nmpc-rti", "lqr", "pid")
    },
    "`ttempc`, `guided = axle`": ('controller.options.guided="axle"',),
}

STUDIES: Final = (
    Study(
        name="tool",
        scenarios=("cultivate",),
        axes={
            "sensors": {"scenario's": (), "and IMUs": ("sensors.imu.on=true",)},
            "controller": CONTROLLERS,
        },
        seeds=_SEEDS,
        table=lambda runs: grouped(
            runs,
            ["sensors", "controller"],
            {
                "sensors": label("sensors", "{}"),
                "controller": label("controller", "{}"),
                "tool, p95": mean("tracking.all.tool.cross_p95_m"),
                "trailer axle": mean("tracking.all.trailer.cross_p95_m"),
                "tractor": mean("tracking.all.tractor.cross_p95_m"),
                "lost": lost,
            },
        ),
        checks=(("cultivate", "ttempc"),),
    ),
)
