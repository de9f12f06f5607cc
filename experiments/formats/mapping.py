"""Map of a foreign record: names of its columns, topics and joints, and the point that it logs."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT, Positive, read_toml, validated
from ..errors import UnreadableFile
from .field import FieldSettings

Point = Literal["antenna", "axle", "implement"]
Offset = Annotated[float, Field(ge=-30, le=30)]

JOINTS: Final = {
    "front_steering": "steering_rad",
    "trailer_steering": "trailer_steering_rad",
    "hitch": "hitch_rad",
}
"""Columns by the names of joints in our own bags."""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class FormatMap:
    """What a file does not say of itself."""

    field: FieldSettings = FieldSettings()
    """Place of the map frame; zone of UTM coordinates."""
    decimal: Literal["", ".", ","] = ""
    """Decimal character of a table of columns; empty: as its numbers say."""
    columns: Mapping[str, str] = Field(default_factory=dict)
    """Names in the header of a table by quantities with a unit; "-name" changes the sign."""
    topics: Mapping[str, str] = Field(default_factory=dict)
    """Topics of a ROS bag by role: fix, odometry, imu, joint_states, commands (of joints),
    ackermann, each also with trailer_ before it; absent: by the type of the message."""
    joints: Mapping[str, str] = Field(default_factory=lambda: dict(JOINTS))
    """Columns of the table by names of joints in JointState messages; "-column" changes the
    sign."""
    wheel_radius_m: Positive | None = None
    """Radius of the rear wheels, for a joint `rear_wheel` with a velocity; absent: the
    vehicle's."""
    point: Point = "antenna"
    """Logged point: "antenna", the receiver on the tractor's mast; "axle", the centre of the rear
    axle; "implement", a point that the program computes at the tool or the trailer."""
    antenna_m: tuple[Offset, Offset, Offset] | None = None
    """Antenna's place ahead of, left of and above the rear axle; absent: above its centre."""


def read_map(file: Path | None) -> FormatMap:
    """Return the map in a TOML file, the default one without a file.

    Raises:
        UnreadableFile: a key is unknown or its value not allowed.
    """
    if file is None:
        return FormatMap()
    content = read_toml(file, UnreadableFile)
    try:
        return validated(FormatMap, content, UnreadableFile, file.parent)
    except UnreadableFile as error:
        raise UnreadableFile(f"{file}: {error}") from None
