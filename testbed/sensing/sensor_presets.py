"""Named sets of sensor settings: the values that `[sensors]` of a scenario starts from."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, Literal

SensorPreset = Literal["paper", "field"]

SENSOR_PRESETS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        # Kayacan, Ramon and Saeys (2016), sec. II: the defaults of `SensorSpecification`.
        "paper": {},
        "field": {
            # The size is that of the paper's RTK receivers, sec. II, so that a comparison with
            # "paper" shows the effect of the correlation alone. Rural RTK in motion has 1.4 cm
            # across the row (Carballido 2014, 610 rows), and 0.6 to 6.1 cm against a total station.
            "gnss_sd_m": 0.03,
            # First-order Gauss-Markov, as Odolinski (2012, doi 10.1007/s10291-011-0213-0) fits it
            # to network RTK. The 13 to 17 min of its slow part are a constant offset over a lap; a
            # minute, near the lower end of carrier multipath (10 to 900 s, Joerger and Pervan
            # 2020), moves within a lap. Time and white share are assumed.
            "gnss_error": "correlated",
            "gnss_correlation_time_s": 60.0,
            "gnss_white_share": 0.1,
            # Antennas on masts, their lever arms corrected with the attitude that an IMU measures.
            "gnss_antenna": "corrected",
            "imu": {"on": True},
            # Assumed. Receivers state below 0.02 s where they extrapolate the base station's
            # phase, and 0.5 to 2 s where they wait for it (manuals of Trimble BD950 and 5700).
            "gnss_latency_s": 0.2,
        },
    }
)
"""Settings that differ from the defaults of `SensorSpecification`, by the name of the preset."""


def with_preset(table: Mapping[str, Any]) -> dict[str, Any]:
    """Return a table `[sensors]` with the values of its preset under the keys that it gives.

    A resolved table gives every key, so that its preset changes nothing. An unknown preset adds
    nothing; the validation of the table refuses it.
    """
    preset = SENSOR_PRESETS.get(str(table.get("preset")), {})
    return {**preset, **{key: _over(preset.get(key), value) for key, value in table.items()}}


def _over(below: object, value: object) -> object:
    """Return a value that a table gives; a table of its own lies over that of the preset."""
    if isinstance(below, Mapping) and isinstance(value, Mapping):
        return {**below, **value}
    return value
