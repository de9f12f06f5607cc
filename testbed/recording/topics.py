"""Topics of a run for viewers, in addition to its flat channels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

TRANSFORMS_TOPIC: Final = "/tf"
TRACTOR_TOPIC: Final = "/tractor/pose"
TRAILER_TOPIC: Final = "/trailer/pose"
DRIVEN_TOPIC: Final = "/tractor/path"  # so far, every few seconds, later less often
DRIVEN_TRAILER_TOPIC: Final = "/trailer/path"
REFERENCE_PATH_TOPIC: Final = "/reference/path"  # once, at the start of the run
PREDICTED_PATH_TOPIC: Final = "/mpc/predicted_path"  # of the tractor point, every control tick
PREDICTED_TRAILER_PATH_TOPIC: Final = "/mpc/predicted_path_trailer"
GNSS_TOPIC: Final = "/gnss/tractor"  # as measured
GNSS_TRAILER_TOPIC: Final = "/gnss/trailer"
SCENE_TOPIC: Final = "/scene"  # once: ground and vehicle, the vehicle fixed to its frames
EVENT_TOPIC: Final = "/log"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with the protobuf schema of its messages."""

    name: str
    schema_name: str  # as "foxglove.Log"
    schema: bytes  # serialised FileDescriptorSet
    metadata: Mapping[str, str]  # "description", and the unit of each number by its name
