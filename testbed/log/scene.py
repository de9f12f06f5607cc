"""Scene of a log for viewers and films: ground, motion of every body, drawn paths."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from mcap.records import Message

from ttempc.types import FloatArray

from ..errors import InvalidField, LogError
from ..ground.ground import GROUND_FILE, Ground
from ..recording.channels import TRANSFORMS_TOPIC
from .reader import Content, decoding

MODEL_FILE: Final = "model.xml"  # the attachment of a log


# Limits of the MJCF in a log: MuJoCo opens files, plugins and gigabytes if a model says so.
_MOST_CHARACTERS: Final = 4_000_000  # ours have 200,000
_MOST_LEVELS: Final = 32
_MOST_PIXELS: Final = 4096  # of a side of a texture or picture
_MOST_CELLS: Final = 20_000_000  # of a height field

# Elements and attributes of the models that this program writes (`vehicle_model.level_mjcf`). None
# of the attributes names a file, none of the elements includes, replicates or loads anything.
_ELEMENTS: Final = frozenset(
    """
    mujoco compiler option flag size statistic visual global headlight map default geom joint
    asset texture material mesh hfield worldbody light body inertial camera frame site tendon
    fixed equality actuator general contact exclude pair keyframe key sensor
    """.split()  # noqa: SIM905 - eighty words
)
_ATTRIBUTES: Final = frozenset(
    """
    model angle cone integrator iterations jacobian island memory center extent offheight offwidth
    ambient diffuse specular zfar znear class conaffinity contype friction group hfield mass
    material mesh name pos priority quat rgba size solref type armature axis coef damping joint
    joint1 joint2 polycoef range solimp solreflimit builtin colorspace height rgb1 rgb2 width
    emission shininess texture face vertex ncol nrow dir diaginertia mode springlength biasprm
    biastype ctrlrange dynprm dyntype forcerange gainprm gaintype input tendon timestep
    fullinertia margin gap stiffness frictionloss limited ref springref body1 body2 geom1 geom2
    condim solmix actuatorfrcrange euler zaxis fovy castshadow active childclass target
    """.split()  # noqa: SIM905 - eighty words
)
_PIXELS: Final = ("width", "height", "offwidth", "offheight")
_MEMORY: Final = re.compile(r"[1-9]\d?M")  # of the stack of the simulation, below 100 MB


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
        return [_line(message) for message in content.messages.get(topic, [])]


def _line(message: Message) -> Line:
    poses = PosesInFrame.FromString(message.data).poses
    points = [(pose.position.x, pose.position.y, pose.position.z) for pose in poses]
    return Line(message.log_time / 1e9, np.array(points, dtype=float).reshape(-1, 3))


def check_model(text: str) -> None:
    """Refuse a model that is not of the kind that this program writes.

    Raises:
        ValueError: with the element, attribute or size that is not allowed, and the limit.
    """
    if len(text) > _MOST_CHARACTERS:
        raise ValueError(f"has {len(text)} characters, at most {_MOST_CHARACTERS}")
    if "<!DOCTYPE" in text:
        raise ValueError("a document type is not allowed")
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"is no XML: {error}") from None
    level, elements = 0, [root]
    while elements:
        level += 1
        if level > _MOST_LEVELS:
            raise ValueError(f"more than {_MOST_LEVELS} elements inside each other")
        for element in elements:
            _check_element(element)
        elements = [below for element in elements for below in element]


def _check_element(element: ElementTree.Element) -> None:
    if element.tag not in _ELEMENTS:
        raise ValueError(f"the element {element.tag} is not allowed")
    for name, value in element.attrib.items():
        if name not in _ATTRIBUTES:
            raise ValueError(f"the attribute {name} of {element.tag} is not allowed")
        if name == "memory" and not _MEMORY.fullmatch(value):
            raise ValueError(f"memory is {value!r}, must be from 1M to 99M")
        if name in _PIXELS and not _at_most(value, _MOST_PIXELS):
            raise ValueError(f"{name} of {element.tag} is {value!r}, at most {_MOST_PIXELS}")
    rows, columns = element.get("nrow", "0"), element.get("ncol", "0")
    if not (_at_most(rows, _MOST_CELLS) and _at_most(columns, _MOST_CELLS)) or (
        int(rows) * int(columns) > _MOST_CELLS
    ):
        raise ValueError(f"a height field of {rows} x {columns} points, at most {_MOST_CELLS}")


def _at_most(text: str, limit: int) -> bool:
    return len(text) < 12 and text.isascii() and text.isdigit() and int(text) <= limit
