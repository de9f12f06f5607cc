"""Draft of tillage implements after ASABE D497.

    D = F_i (A + B S + C S^2) W T

with the draft D [N], the factor F_i of the soil's texture, the speed S [km/h], the width W [m] or
the number of tools, and the depth T [cm]. The standard gives the range of a draft in other fields,
which is not modelled.

Sources. The standard itself was not read. A, B and C of the subsoiler, the disk harrows and the
field cultivators, with their factors and ranges, were compared with a public transcription
(github.com/chris-hermann/tcc, parameters.py); A and B of the chisel plough with a worked example
(progressivegardening.com, "Metric Problems": 45 shanks, 15 cm, 10 km/h, factor 0.7: 68512.5 N). The
factors of the chisel plough and all numbers of the row-crop cultivator are from memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Annotated, Final, Literal

from pydantic import AfterValidator, Field

from ..errors import InvalidPlant

Texture = Literal["fine", "medium", "coarse"]

_KMH_PER_MPS: Final = 3.6
_CM_PER_M: Final = 100.0


@dataclass(frozen=True, slots=True)
class DraftEquation:
    """Parameters of one implement in the table of ASABE D497."""

    a: float  # [N/cm] per tool, or per metre of width
    b: float  # [N/cm] per km/h
    c: float  # [N/cm] per (km/h)^2
    fine: float  # factor F_1
    medium: float  # F_2
    coarse: float  # F_3
    spacing_m: float | None  # usual distance between tools, assumed; None: the width counts

    def coefficients(self, texture: Texture) -> tuple[float, float, float]:
        """Return draft per tool (or metre) and metre of depth as a + b v + c v^2, v [m/s].

        In N/m, N s/m^2 and N s^2/m^3.
        """
        factor = _CM_PER_M * getattr(self, texture)
        return factor * self.a, factor * self.b * _KMH_PER_MPS, factor * self.c * _KMH_PER_MPS**2


# range of the draft: 50 % (chisel plough, subsoiler, disk harrow), 30 % (second pass of the disk
# harrow, field cultivator), 25 % (its second pass), 15 % (row-crop cultivator)
IMPLEMENTS: Final[Mapping[str, DraftEquation]] = MappingProxyType(
    {
        "chisel-plough": DraftEquation(91.0, 5.4, 0.0, 1.0, 0.85, 0.65, 0.30),
        "subsoiler": DraftEquation(226.0, 0.0, 1.8, 1.0, 0.70, 0.45, 0.75),
        "disk-harrow": DraftEquation(309.0, 16.0, 0.0, 1.0, 0.88, 0.78, None),
        "disk-harrow-second": DraftEquation(216.0, 11.2, 0.0, 1.0, 0.88, 0.78, None),
        "field-cultivator": DraftEquation(46.0, 2.8, 0.0, 1.0, 0.85, 0.65, 0.20),
        "field-cultivator-second": DraftEquation(32.0, 1.9, 0.0, 1.0, 0.85, 0.65, 0.20),
        "row-crop-cultivator": DraftEquation(140.0, 7.0, 0.0, 1.0, 0.85, 0.65, 0.75),
    }
)
"""Implements by name; "second" is secondary tillage, the others primary tillage."""


def draft_equation(name: str) -> DraftEquation:
    """Return the draft parameters of an implement.

    Raises:
        InvalidPlant: there is no implement of that name.
    """
    if name not in IMPLEMENTS:
        allowed = ", ".join(IMPLEMENTS)
        raise InvalidPlant(f"implement.type: got {name!r}, must be one of {allowed}")
    return IMPLEMENTS[name]


def _known(name: str) -> str:
    draft_equation(name)
    return name


ImplementType = Annotated[
    str, AfterValidator(_known), Field(json_schema_extra={"enum": list(IMPLEMENTS)})
]
"""Type of a setting: the name of an implement; another name raises `InvalidPlant`."""
