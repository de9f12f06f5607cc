"""Controllers with receivers as recorded under an open sky and at the edge of a wood."""

from typing import Final

from ....testbed.sensing.receivers import PLACES
from ..markdown import grouped, label, lost, mean
from ..table import Table, listed, study

_RECEIVERS: Final = "sensors.gnss_error"
_CELLS: Final = {
    "receivers": label(_RECEIVERS, "`{}`"),
    "controller": label("controller", "`{}`"),
    "trailer, p95 [cm]": mean("tracking.all.trailer.cross_p95_m"),
    "tractor, p95 [cm]": mean("tracking.all.tractor.cross_p95_m"),
    "lost": lost,
}

TABLES: Final = (
    Table(
        name="receivers",
        studies={
            "receivers": study(
                "grass-field",
                range(921, 941),
                ("path.laps=1",),
                listed(_RECEIVERS, *PLACES[:2]),
                listed("controller", "ttempc", "pid", "lqr", "nmpc-rti"),
            )
        },
        text=lambda runs: grouped(runs, [_RECEIVERS, "controller"], _CELLS),
        checks=(("grass-field", "ttempc"),),
    ),
)
