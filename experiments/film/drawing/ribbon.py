"""Ribbons: lines on the ground that follow its bumps and change from frame to frame."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ....testbed.ground.terrain import Terrain


def add_mesh(
    spec: mujoco.MjSpec, name: str, vertices: FloatArray, faces: np.ndarray, **appearance: object
) -> None:
    """Add a mesh to the world, with a normal and a texture coordinate per vertex.

    Args:
        spec: to add to.
        name: of mesh and geom.
        vertices: in the map frame [m], (n, 3); `MeshView` can change them later.
        faces: indices of vertices, (m, 3).
        appearance: further attributes of the geom.
    """
    up = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    mesh = spec.add_mesh(
        name=name,
        uservert=vertices.ravel(),
        usernormal=up.ravel(),
        usertexcoord=np.zeros(2 * len(vertices)),
        userface=faces.ravel(),
        userfacenormal=faces.ravel(),
        userfacetexcoord=faces.ravel(),
    )
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # the mesh has no volume
    spec.worldbody.add_geom(
        name=name,
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname=name,
        contype=0,
        conaffinity=0,
        **appearance,
    )


class MeshView:
    """Writable views of the vertices of a compiled mesh of `add_mesh`, in the map frame."""

    def __init__(self, model: mujoco.MjModel, name: str) -> None:
        self.id = model.mesh(name).id
        geom = model.geom(name).id
        # The compiler moves a mesh to its centre of mass and principal axes; undo that.
        model.geom_pos[geom], model.geom_quat[geom] = 0.0, (1.0, 0.0, 0.0, 0.0)
        count = model.mesh_vertnum[self.id]

        def part(array: np.ndarray, start: int) -> np.ndarray:
            return array[start : start + count]

        self.vertices = part(model.mesh_vert, model.mesh_vertadr[self.id])  # (n, 3)
        self.normals = part(model.mesh_normal, model.mesh_normaladr[self.id])  # (n, 3)
        self.normals[:] = (0.0, 0.0, 1.0)
        self.texture_coordinates = part(
            model.mesh_texcoord, model.mesh_texcoordadr[self.id]
        )  # (n, 2)


def strip_faces(rows: int, columns: int) -> np.ndarray:
    """Return the triangles (m, 3) of a grid of vertices numbered row by row, facing up."""
    corner = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    return np.concatenate(
        [np.stack([a, b, d], axis=-1).reshape(-1, 3), np.stack([a, d, c], axis=-1).reshape(-1, 3)]
    ).astype(np.int32)


class Ribbon:
    """A ribbon of fixed width over up to `capacity` points, `lift_m` above the ground."""

    def __init__(
        self, name: str, capacity: int, width_m: float, lift_m: float, material: str = "line"
    ) -> None:
        self.name, self._material = name, material
        self._capacity, self._width, self._lift = max(capacity, 2), width_m, lift_m

    def add_to(self, spec: mujoco.MjSpec, rgba: Sequence[float]) -> None:
        """Add the ribbon to the model at an arbitrary position."""
        along = np.arange(self._capacity, dtype=float)
        left = np.column_stack([along, np.full_like(along, self._width), np.zeros_like(along)])
        right = left * [1.0, 0.0, 1.0]
        # Right edge before left edge: counter-clockwise seen from above.
        vertices = np.concatenate([right, left])  # (2 capacity, 3)
        faces = strip_faces(2, self._capacity)
        add_mesh(spec, self.name, vertices, faces, rgba=rgba, material=self._material)

    def lay(self, mesh: MeshView, points: FloatArray, terrain: Terrain) -> None:
        """Lay the ribbon over points (n, 2) [m], at most `capacity`; fewer than two hide it."""
        if len(points) < 2:
            mesh.vertices[:] = (0.0, 0.0, -1e3)
            return
        along = np.gradient(points, axis=0)  # (n, 2)
        along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
        across = 0.5 * self._width * np.column_stack([-along[:, 1], along[:, 0]])
        for half, edge in enumerate((points - across, points + across)):
            line = np.column_stack([edge, terrain.height(edge[:, 0], edge[:, 1]) + self._lift])
            vertices = mesh.vertices[half * self._capacity : (half + 1) * self._capacity]
            vertices[: len(line)] = line
            vertices[len(line) :] = line[-1]
