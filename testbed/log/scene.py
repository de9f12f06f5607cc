"""Scene of a log for viewers and films: ground, motion of every body, drawn paths."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame

from ttempc.types import FloatArray

from ..errors import InvalidField, LogError
from ..ground.ground import GROUND_FILE, Ground
from ..recording.channels import TRANSFORMS_TOPIC
from .model_whitelist import check_model
from .reader import Content, decoding

MODEL_FILE: Final = "model.xml"  # the attachment of a log


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of every body of the vehicle."""

    body_names: tuple[str, ...]
    time_s: FloatArray  # (n,)
    xyz: FloatArray  # (n, bodies, 3) [m] map frame
    quat: FloatArray  # (n, bodies, 4) w, x, y, z


@dataclass(frozen=True, slots=True)
class Line:
    """A path that is drawn from one moment on."""

    time_s: float
    points: FloatArray  # (n, 3) [m] map frame


def ground_of(content: Content) -> Ground:
    """Return the ground of the run.

    Raises:
        LogError: the log has no ground.
    """
    try:
        return Ground.from_npz(attachment(content, GROUND_FILE))
    except InvalidField as error:
        raise LogError(f"{content.path}: {error}") from error


def attachment(content: Content, name: str) -> bytes:
    """Return an attachment, "scenario.toml", "vehicle.toml", "model.xml" or "ground.npz".

    Raises:
        LogError: the log has none of that name.
    """
    try:
        return content.attachments[name]
    except KeyError:
        raise LogError(f"{content.path}: holds no {name}") from None


def model_of(content: Content) -> str:
    """Return the MuJoCo model of the vehicle as XML, which opens no file and has a bounded size.

    Raises:
        LogError: the log has none, or it holds what this program does not write.
    """
    data = attachment(content, MODEL_FILE)
    try:
        text = data.decode()
        check_model(text)
    except ValueError as error:
        raise LogError(f"{content.path}: {MODEL_FILE}: {error}") from None
    return text


def motion_of(content: Content) -> Motion:
    """Return the motion of every body.

    Raises:
        LogError: the log has no transforms, or they do not decode.
    """
    messages = content.messages.get(TRANSFORMS_TOPIC)
    if not messages:
        raise LogError(f"{content.path}: holds nothing on {TRANSFORMS_TOPIC}")
    with decoding(content.path, TRANSFORMS_TOPIC):
        first = FrameTransforms.FromString(messages[0].data).transforms
        names = tuple(transform.child_frame_id for transform in first)
        poses = np.empty((len(messages), len(names), 7))
        for row, message in zip(poses, messages, strict=True):
            transforms = FrameTransforms.FromString(message.data).transforms
            row[:] = [
                (at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z)
                for at, turn in ((each.translation, each.rotation) for each in transforms)
            ]
        if not (names and np.isfinite(poses).all() and np.any(poses[..., 3:], axis=2).all()):
            raise ValueError("no poses")
    time_s = np.array([message.log_time for message in messages]) / 1e9
    return Motion(names, time_s, poses[..., :3].copy(), poses[..., 3:].copy())


def lines_of(content: Content, topic: str) -> Sequence[Line]:
    """Return the paths of a topic in the order of their times; empty where there are none.

    Raises:
        LogError: they do not decode.
    """
    with decoding(content.path, topic):
        lines = []
        for message in content.messages.get(topic, []):
            places = [pose.position for pose in PosesInFrame.FromString(message.data).poses]
            points = np.array([(at.x, at.y, at.z) for at in places], dtype=float)
            lines.append(Line(message.log_time / 1e9, points.reshape(-1, 3)))
        return lines
