"""Registry of faults: the tables of `[[faults]]` by their kinds, and the table of docs/faults.md.

A new kind is a dataclass in one of the modules of this folder, and its name in `AnyFault`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields
from typing import Annotated, Final, get_args, get_type_hints

from pydantic import Field

from .command_faults import (
    CommandsLate,
    CommandsLost,
    HydrostatCut,
    HydrostatSluggish,
    ValveHardOver,
    ValvePlay,
    ValveSlow,
    ValveStuck,
)
from .fault import Fault, LastingFault
from .gnss_faults import (
    AntennasSwapped,
    GnssDrift,
    GnssFloat,
    GnssJump,
    GnssLate,
    GnssLoss,
    GnssOutlier,
)
from .ground_faults import DitchAcross, SoilPatch, StepAcross
from .plant_faults import Gust, LoadShift, SteeringFree, Stone, TyreFlat
from .sensor_faults import (
    AngleBias,
    AngleDrift,
    AngleNoise,
    AngleStuck,
    EncoderDead,
    EncoderScaled,
    GyroBias,
    SamplesDuplicated,
    StampsShifted,
)

AnyFault = Annotated[
    GnssLoss
    | GnssJump
    | GnssDrift
    | GnssOutlier
    | GnssFloat
    | GnssLate
    | AntennasSwapped
    | AngleStuck
    | AngleBias
    | AngleDrift
    | AngleNoise
    | GyroBias
    | EncoderDead
    | EncoderScaled
    | SamplesDuplicated
    | StampsShifted
    | CommandsLost
    | CommandsLate
    | ValveStuck
    | ValveSlow
    | ValveHardOver
    | ValvePlay
    | HydrostatCut
    | HydrostatSluggish
    | SteeringFree
    | LoadShift
    | TyreFlat
    | Gust
    | Stone
    | SoilPatch
    | DitchAcross
    | StepAcross,
    Field(discriminator="kind"),
]
"""A table with a key `kind`."""

_FAMILIES: Final[tuple[type[Fault], ...]] = get_args(get_args(AnyFault)[0])
_COMMON: Final = {field.name for field in fields(LastingFault)}

KINDS: Final[dict[str, type[Fault]]] = {
    kind: family for family in _FAMILIES for kind in get_args(get_type_hints(family)["kind"])
}
"""Dataclass of each kind of fault."""


def kinds_table() -> str:
    """Return the Markdown table of all kinds with their own keys and effects."""
    lines = ["| kinds | keys beside the common ones | effect |", "|---|---|---|"]
    for family in _FAMILIES:
        kinds = ", ".join(f"`{kind}`" for kind, owner in KINDS.items() if owner is family)
        effect = (family.__doc__ or "").splitlines()[0]
        lines.append(f"| {kinds} | {', '.join(_keys(family)) or '-'} | {effect} |")
    return "\n".join(lines)


def _keys(family: type[Fault]) -> Iterator[str]:
    """Yield the keys of a family with their defaults or choices."""
    hints = get_type_hints(family)
    for field in fields(family):
        if field.name in _COMMON:
            continue
        default = getattr(family, field.name, None)
        choices = " or ".join(f'"{choice}"' for choice in get_args(hints[field.name]) if choice)
        if isinstance(default, (str, float)):
            yield f"`{field.name}` ({default})"
        elif choices and all(isinstance(c, str) for c in get_args(hints[field.name])):
            yield f"`{field.name}`: {choices}"
        else:
            yield f"`{field.name}`"
