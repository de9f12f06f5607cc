"""Controllers with receivers as recorded under an open sky and at the edge of a wood."""

import pandas as pd

from ....testbed.sensing.receivers import PLACES
from ..study import Study
from ..tables import grouped, label, lost, mean

_CONTROLLERS = ("ttempc", "pid", "lqr", "nmpc-rti")


def _table(frame: pd.DataFrame) -> str:
    """Return the mean over seeds of the 95th percentile of the cross-track errors [cm]."""
    cells = {
        "receivers": label("receivers", "`{}`"),
        "controller": label("driver", "`{}`"),
        "trailer, p95 [cm]": mean("tracking.all.trailer.cross_p95_m"),
        "tractor, p95 [cm]": mean("tracking.all.tractor.cross_p95_m"),
        "lost": lost,
    }
    return grouped(frame, ["receivers", "driver"], cells)


STUDIES = (
    Study(
        name="receivers",
        table=_table,
        scenarios=("grass-field",),
        axes={
            "receivers": {place: (f'sensors.gnss_error="{place}"',) for place in PLACES[:2]},
            "driver": {name: (f'controller.name="{name}"',) for name in _CONTROLLERS},
        },
        seeds=tuple(range(921, 941)),
        checks=(("grass-field", "ttempc"),),
    ),
)
