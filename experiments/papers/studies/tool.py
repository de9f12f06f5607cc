"""The tool on `cultivate`: controllers that guide the tool or the axle, with and without IMUs."""

from typing import Final

from ..markdown import grouped, label, lost, mean
from ..table import Table, study, variants

_SEEDS: Final = range(9501, 9521)  # 21 to 40 were those of tuning
_SENSORS: Final = {"scenario's": (), "without IMUs": ("sensors.imu.on=false",)}
_CONTROLLERS: Final = {
    **{
        f"`{name}`": (f'controller.name="{name}"',) for name in ("ttempc", "nmpc-rti", "lqr", "pid")
    },
    "`ttempc`, `guided = axle`": ('controller.options.guided="axle"',),
}
_CELLS: Final = {
    "sensors": label("sensors", "{}"),
    "controller": label("variant", "{}"),
    "tool, p95": mean("tracking.all.tool.cross_p95_m"),
    "trailer axle": mean("tracking.all.trailer.cross_p95_m"),
    "tractor": mean("tracking.all.tractor.cross_p95_m"),
    "lost": lost,
}

TABLES: Final = (
    Table(
        name="tool",
        studies={
            "tool": study(
                "cultivate",
                _SEEDS,
                ("path.laps=1",),
                variants("sensors", _SENSORS),
                variants("variant", _CONTROLLERS),
            )
        },
        text=lambda runs: grouped(runs, ["sensors", "variant"], _CELLS),
        checks=(("cultivate", "ttempc"),),
    ),
)
