"""Scenery: static data for viewers, the shapes of vehicle and field."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false
import math
from dataclasses import dataclass
from typing import Any, Final

import mujoco
import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TriangleListPrimitive_pb2 import TriangleListPrimitive
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ..geodesy import DEFAULT_FRAME, MapFrame
from ..ground.ground import Ground
from ..vehicle.appearance import ground_colours
from .encoding import MAP_FRAME, Template, hole, single

_GEOM: Final = mujoco.mjtGeom
# MuJoCo's default colour: that of the material applies
_UNPAINTED: Final = np.array([0.5, 0.5, 0.5, 1.0], np.float32)
_HIDDEN_GROUP: Final = 3  # shapes of this group and above serve contacts and are not drawn
_MOST_VERTICES: Final = 30_000  # of the drawn ground: 0.4 m apart on the default field
_ABOVE_GROUND_M: Final = 0.05  # of paths: the drawn ground is coarser than the true one


@dataclass(frozen=True, slots=True)
class Scenery:
    """Data for viewers that do not change during a run."""

    body_names: tuple[str, ...] = ()
    ground: Ground | None = None  # None: level ground
    shapes: bytes = b""  # a foxglove.SceneUpdate; empty where there is nothing to show
    frame: MapFrame = DEFAULT_FRAME  # place of the map on the earth

    def on_ground(self, points: FloatArray) -> FloatArray:
        """Return points (n, 2) [m] with the height at which a path is drawn, (n, 3) [m]."""
        drawn = np.full((len(points), 3), _ABOVE_GROUND_M)
        drawn[:, :2] = points
        if self.ground is not None:
            drawn[:, 2] += self.ground.terrain.height(points[:, 0], points[:, 1])
        return drawn


def shapes_of(model: mujoco.MjModel, ground: Ground) -> bytes:
    """Return ground and vehicle as a foxglove.SceneUpdate.

    Every body is an entity in its own frame. It is sent once; the transforms move it.

    Args:
        model: with all drawn shapes.
        ground: drawn instead of the model's.
    """
    field = SceneEntity(id="ground", frame_id=MAP_FRAME, frame_locked=True)
    field.triangles.append(_ground(ground))
    bodies = []
    for body in range(1, model.nbody):
        name = model.body(body).name
        entity = SceneEntity(id=name, frame_id=name, frame_locked=True)
        first = model.body_geomadr[body]
        for geom in range(first, first + model.body_geomnum[body]):
            if model.geom_group[geom] < _HIDDEN_GROUP:
                _add_shape(entity, model, geom)
        bodies.append(entity)
    return SceneUpdate(entities=[field, *bodies]).SerializeToString()


def _add_shape(entity: SceneEntity, model: mujoco.MjModel, geom: int) -> None:
    """Add a geom of the model to its body's entity."""
    kind = _GEOM(int(model.geom_type[geom]))
    (a, b, c) = 2.0 * model.geom_size[geom]
    material = model.geom_matid[geom]
    colour = model.geom_rgba[geom]
    if material >= 0 and np.array_equal(colour, _UNPAINTED):
        colour = model.mat_rgba[material]
    if kind == _GEOM.mjGEOM_MESH:
        shape = entity.triangles.add()
        shape.CopyFrom(_mesh(model, model.geom_dataid[geom]))
    elif kind == _GEOM.mjGEOM_BOX:
        shape = entity.cubes.add()
        _put(shape.size, (a, b, c), "xyz")
    elif kind in (_GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID):
        shape = entity.spheres.add()
        _put(shape.size, (a, a, a) if kind == _GEOM.mjGEOM_SPHERE else (a, b, c), "xyz")
    elif kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE):
        shape = entity.cylinders.add(bottom_scale=1.0, top_scale=1.0)
        _put(shape.size, (a, a, b), "xyz")
    else:
        raise ValueError(f"geom {model.geom(geom).name}: viewers have no shape of its type")
    _put(shape.pose.position, model.geom_pos[geom], "xyz")
    _put(shape.pose.orientation, model.geom_quat[geom], "wxyz")
    _put(shape.color, colour, "rgba")


def _put(message: Any, values: Any, names: str) -> None:  # noqa: ANN401 - protobuf has no types
    for name, value in zip(names, values, strict=True):
        setattr(message, name, float(value))


def _mesh(model: mujoco.MjModel, mesh: int) -> TriangleListPrimitive:
    first = model.mesh_vertadr[mesh]
    count = model.mesh_vertnum[mesh]
    face = model.mesh_faceadr[mesh]
    faces = model.mesh_facenum[mesh]
    return _triangles(
        model.mesh_vert[first : first + count].astype(float),
        model.mesh_face[face : face + faces],
    )


def _ground(ground: Ground) -> TriangleListPrimitive:
    """Return the ground on a subset of its grid points, in the colours of its soil."""
    terrain = ground.terrain
    stride = max(1, math.ceil(math.sqrt(terrain.heights.size / _MOST_VERTICES)))
    (x, y) = terrain.points()
    heights = terrain.heights
    rows, columns = (_every(stride, n) for n in heights.shape)
    height = heights[np.ix_(rows, columns)]  # (ny, nx)
    ny, nx = height.shape
    points = np.stack(np.broadcast_arrays(x[columns], y[rows], height), axis=-1)
    colours = ground_colours(terrain, ground.cone_index, ny, nx)  # (ny, nx, 3)
    here = (np.arange(ny - 1)[:, None] * nx + np.arange(nx - 1)).ravel()
    faces = np.column_stack([here, here + 1, here + nx, here + nx, here + 1, here + nx + 1])
    return _triangles(points.reshape(-1, 3), faces.reshape(-1, 3), colours.reshape(-1, 3))


def _every(stride: int, count: int) -> NDArray[np.int64]:
    """Return indices a stride apart from the first to the last, both included."""
    return np.rint(np.linspace(0, count - 1, math.ceil((count - 1) / stride) + 1)).astype(int)


def _triangles(
    points: FloatArray, faces: NDArray[np.integer], colours: FloatArray | None = None
) -> TriangleListPrimitive:
    """Return triangles; parsed from joined templates: 25 000 message objects would take 0.2 s."""
    wire = _VERTEX.fill(single(points)).tobytes()
    if colours is not None:
        wire += _COLOUR.fill(single(np.column_stack([colours, np.ones(len(colours))]))).tobytes()
    triangles = TriangleListPrimitive.FromString(wire)
    triangles.indices.extend(faces.ravel().tolist())
    return triangles


_VERTEX: Final = Template(TriangleListPrimitive(points=[Point3(x=hole(0), y=hole(1), z=hole(2))]))
_COLOUR: Final = Template(
    TriangleListPrimitive(colors=[Color(r=hole(0), g=hole(1), b=hole(2), a=hole(3))])
)
