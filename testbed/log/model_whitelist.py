"""Whitelist of the MJCF in a log: MuJoCo opens files, plugins and gigabytes if a model says so."""

import re
import xml.etree.ElementTree as ElementTree
from typing import Final

_MOST_CHARACTERS: Final = 4_000_000  # the project's own models have 200,000
_MOST_LEVELS: Final = 32
_MOST_PIXELS: Final = 4096  # of a side of a texture or picture
_MOST_CELLS: Final = 20_000_000  # of all height fields
_MOST_ALL_PIXELS: Final = 2**24  # of all textures; ours have 2,800,000
_MOST_ELEMENTS: Final = 2_000  # bodies, geoms, keyframes and all others; ours have 230

# Elements and attributes of the models that this program writes (`vehicle_model.level_model`). None
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
    condim solmix actuatorfrclimited actuatorfrcrange euler zaxis fovy castshadow active childclass
    target
    """.split()  # noqa: SIM905 - eighty words
)
_MOST: Final = {
    **dict.fromkeys(("width", "height", "offwidth", "offheight"), _MOST_PIXELS),
    **dict.fromkeys(("nrow", "ncol"), _MOST_CELLS),
}
_COUNT: Final = re.compile(r"[0-9]{1,11}")
_MEMORY: Final = re.compile(r"[1-9]\d?M")  # of the stack of the simulation, below 100 MB


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
    _check_element(root, 1)
    _check_sums(root)


def _check_sums(root: ElementTree.Element) -> None:
    """Refuse parts that are allowed one by one and together take gigabytes or minutes."""
    elements = pixels = cells = 0
    for each in root.iter():
        sides = 1 if each.get("type") == "2d" else 6  # of a cube or a sky
        elements += 1
        pixels += sides * int(each.get("width", 0)) * int(each.get("height", 0))
        cells += int(each.get("nrow", 0)) * int(each.get("ncol", 0))
    for what, count, most in (
        ("elements", elements, _MOST_ELEMENTS),
        ("pixels of textures", pixels, _MOST_ALL_PIXELS),
        ("points of height fields", cells, _MOST_CELLS),
    ):
        if count > most:
            raise ValueError(f"has {count} {what}, at most {most}")


def _check_element(element: ElementTree.Element, level: int) -> None:
    if level > _MOST_LEVELS:
        raise ValueError(f"more than {_MOST_LEVELS} elements inside each other")
    if element.tag not in _ELEMENTS:
        raise ValueError(f"the element {element.tag} is not allowed")
    for name, value in element.attrib.items():
        if name not in _ATTRIBUTES:
            raise ValueError(f"the attribute {name} of {element.tag} is not allowed")
        if name == "memory" and not _MEMORY.fullmatch(value):
            raise ValueError(f"memory is {value!r}, must be from 1M to 99M")
        if (most := _MOST.get(name)) and not (_COUNT.fullmatch(value) and int(value) <= most):
            raise ValueError(f"{name} of {element.tag} is {value!r}, at most {most}")
    for below in element:
        _check_element(below, level + 1)
