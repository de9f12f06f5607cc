"""MuJoCo scene of a run: vehicle as logged, field, light, and lines on the ground."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ...testbed.errors import first_line
from ...testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from ...testbed.truth import WHEELS
from ...testbed.vehicle.appearance import ground_colours
from ..errors import InvalidFilm
from .camera import FIELD_OF_VIEW, FollowCamera, View
from .drawing.body_poses import place_bodies, rotation
from .drawing.colours import PLAN, REFERENCE, TRACTOR, TRAILER, Rgb, brighter, slip_colour, unit_rgb
from .drawing.field import FieldMesh, mown
from .drawing.offscreen import OffscreenRenderer
from .drawing.ribbon import MeshView, Ribbon
from .ghosts import Ghost
from .replay import Replay
from .shot import Quality, Shot

_HORIZON: Final = (0.80, 0.87, 0.94)  # colour of the sky at the horizon, and of the fog
_SUN: Final = (
    0.45,
    -0.45,
    -0.77,
)  # direction of light: from the north-west, as in the texture
_SUN_AWAY_M: Final = 1.6  # distance of the light; farther away, shadow acne appears on the ground
_TRAIL_STEP_M: Final = 0.25  # between the points of a driven path
_TARGETS: Final = ("target_tractor", "target_trailer")  # markers of the references of both points
_POLE_M: Final = 2.6  # height, above the roof so that the top is always visible
_SHADOW_MAP: Final[dict[Quality, int]] = {"draft": 2048, "high": 4096}  # pixels
_SAMPLES: Final[dict[Quality, int]] = {"draft": 4, "high": 8}  # per pixel
_LINE_LIGHT: Final = 2.5  # of emission, sky and sun together on a line on level ground
_HIDDEN_GROUP: Final = 3  # shapes of this group and above serve contacts and are not drawn
_GHOST_OPACITY: Final = 0.30
_TRACKS: Final = ("rear_left", "rear_right", "trailer_left", "trailer_right")  # wheels
_TRACK_STEP_M: Final = 0.4
_TRACK_WIDTH_M: Final = 0.16
_SOIL: Final = (0.14, 0.11, 0.07, 0.25)  # colour of a wheel track
_EXTENT_M: Final = 4.0  # half the side of the area with shadows
_TEXTURE: Final = (2560, 1600)  # pixels of the ground, width and height


class MujocoScene:
    """Renderer of one run at any time, with the bodies at their logged poses.

    Args:
        replay: the run.
        shot: settings of the film.
        ghosts: vehicles that are drawn translucent.

    Raises:
        InvalidFilm: the log's model and its transforms have different bodies.
        NoGraphics: OpenGL is unavailable.
    """

    def __init__(self, replay: Replay, shot: Shot, ghosts: Sequence[Ghost] = ()) -> None:
        self.replay, self.camera = replay, FollowCamera(replay, shot.speed)
        self._shot, self._ghosts = shot, ghosts
        unit = self.camera.unit
        self._field = FieldMesh(replay.ground.terrain, unit)
        trail = replay.driven(replay.end_s, _TRAIL_STEP_M).shape[1] + 1
        predicted = max(
            (len(line.points) for lines in replay.predicted for line in lines), default=2
        )
        self._reference = Ribbon("reference", len(replay.path), 0.12 * unit, 0.015)
        self._trails = (
            Ribbon("trail_tractor", trail, 0.09 * unit, 0.020),
            Ribbon("trail_trailer", trail, 0.09 * unit, 0.024),
        )
        self._predictions = (
            Ribbon("predicted_tractor", predicted, 0.12 * unit, 0.030),
            Ribbon("predicted_trailer", predicted, 0.12 * unit, 0.030),
        )
        self._track_rows = replay.spaced_rows(_TRACK_STEP_M)
        count, width = len(self._track_rows) + 1, _TRACK_WIDTH_M * unit
        self._tracks = [Ribbon(f"track_{wheel}", count, width, 0.010, "track") for wheel in _TRACKS]
        self.model = self._compiled()
        self.data = mujoco.MjData(self.model)
        ribbons = (self._reference, *self._trails, *self._predictions, *self._tracks)
        meshes = [FieldMesh.NAME, "meadow", *(ribbon.name for ribbon in ribbons)]
        self._meshes = {name: MeshView(self.model, name) for name in meshes}
        self._paint_ground()
        self._bodies = self._body_ids()
        self._lugs = [self.model.geom(f"{wheel}_lugs").id for wheel in WHEELS]
        self.model.geom_matid[self._lugs] = -1  # no material: the colour shows the slip
        self._targets = [self.model.geom(name).id for name in _TARGETS]
        mujoco.mj_kinematics(self.model, self.data)  # poses of the static geoms
        self._field.lay_meadow(self._meshes["meadow"])
        self._reference.lay(self._meshes["reference"], replay.path, replay.ground.terrain)
        self._renderer = OffscreenRenderer(self.model, shot.size)
        self._shell = self._shell_geoms() if ghosts else np.empty(0, np.intp)
        geoms = self.model.ngeom + len(ghosts) * len(self._shell) + 8
        self._scene = mujoco.MjvScene(self.model, geoms)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = 0  # a replay moves bodies only: sites would stay at the start

    def picture(self, camera: str, time_s: float) -> NDArray[np.uint8]:
        """Return the picture of a camera of `camera.VIEWS` at a time, (height, width, 3)."""
        self.pose(time_s)
        self._draw_lines(time_s)
        view = self.camera.view(camera, time_s)
        middle = self.camera.pose(time_s).middle
        if self._field.lay(self._meshes[FieldMesh.NAME], *middle[:2].tolist()):
            self._renderer.upload_mesh(self._meshes[FieldMesh.NAME].id)
        self._light(middle)
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self._options,
            None,
            _camera(view),
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        for ghost in self._ghosts:
            self._add_ghost(ghost, time_s)
        return self._renderer.picture(self._scene)

    def pose(self, time_s: float) -> None:
        """Set the logged poses of all bodies in `data`, and the slip colours of the wheels."""
        place_bodies(self.model, self.data, self._bodies, *self.replay.poses(time_s))
        slips = self.replay.slips(time_s)
        self.model.geom_rgba[self._lugs, :3] = [unit_rgb(slip_colour(slip)) for slip in slips]

    def _compiled(self) -> mujoco.MjModel:
        """Return the log's model with the ground, light and lines of a film."""
        try:
            spec = mujoco.MjSpec.from_string(self.replay.mjcf)
            for light in list(spec.lights):
                spec.delete(light)
            return self._dressed(spec).compile()
        except (ValueError, KeyError, AttributeError) as error:
            raise InvalidFilm(
                f"{self.replay.file}: its model cannot be used: {first_line(error)}"
            ) from None

    def _dressed(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Add ground, light and lines of a film to a model."""
        unit, visual = self.camera.unit, spec.visual
        ground = spec.texture("ground")
        ground.width, ground.height = _TEXTURE
        spec.add_material(name="meadow", specular=0.0)
        spec.add_material(name="line", emission=1.5, specular=0.0)
        spec.add_material(name="track", specular=0.0)
        self._field.add_to(spec)
        self._reference.add_to(spec, (*unit_rgb(REFERENCE), 1.0))
        for ribbon, colour in zip(self._trails, (TRACTOR, TRAILER), strict=True):
            ribbon.add_to(spec, _lit(brighter(colour)))
        for ribbon in self._predictions:
            ribbon.add_to(spec, _lit(PLAN))
        for ribbon in self._tracks:
            ribbon.add_to(spec, _SOIL)
        for name, colour in zip(_TARGETS, (TRACTOR, TRAILER), strict=True):
            spec.worldbody.add_geom(
                name=name,
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[0.018 * unit, 0.5 * _POLE_M * unit, 0.0],
                rgba=_lit(brighter(colour)),
                material="line",
                contype=0,
                conaffinity=0,
            )
        spec.worldbody.add_light(
            name="sun",
            type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
            dir=_SUN,
            castshadow=True,
            ambient=(0.0, 0.0, 0.0),
            diffuse=(0.70, 0.67, 0.60),
            specular=(0.35, 0.35, 0.32),
        )
        visual.headlight.ambient = (0.33, 0.34, 0.37)
        visual.headlight.diffuse = (0.22, 0.22, 0.22)
        visual.headlight.specular = (0.0, 0.0, 0.0)
        visual.rgba.fog = (*_HORIZON, 1.0)
        visual.global_.fovy = math.degrees(FIELD_OF_VIEW)
        quality = self._shot.look.quality
        visual.quality.shadowsize = _SHADOW_MAP[quality]
        visual.quality.offsamples = _SAMPLES[quality]
        # Clipping planes, fog and shadow distance are multiples of the extent.
        spec.stat.extent = _EXTENT_M * unit
        visual.map.znear, visual.map.zfar = 0.05, 60.0
        visual.map.fogstart, visual.map.fogend = 12.0, 55.0
        visual.map.shadowclip = 1.0
        return spec

    def _body_ids(self) -> NDArray[np.intp]:
        """Return the model's ids of the bodies in the order of the log, (n,)."""
        names = self.replay.motion.body_names
        ids = {self.model.body(i).name: i for i in range(self.model.nbody)}
        missing = sorted(set(names) - set(ids))
        if missing:
            raise InvalidFilm(
                f"{self.replay.file}: has transforms of {', '.join(missing)}, which its model lacks"
            )
        return np.array([ids[name] for name in names])

    def _draw_lines(self, time_s: float) -> None:
        """Lay driven and predicted paths on the ground, and move the reference markers."""
        terrain = self.replay.ground.terrain
        driven = self.replay.driven(time_s, _TRAIL_STEP_M, self._shot.look.exaggeration)
        lines = list(zip(self._trails, driven, strict=True))
        lines += zip(self._tracks, self._wheel_paths(time_s), strict=True)
        paths = self.replay.predicted_paths(time_s) or (np.empty((0, 2)), np.empty((0, 2)))
        lines += zip(self._predictions, paths, strict=True)
        for ribbon, points in lines:
            mesh = self._meshes[ribbon.name]
            ribbon.lay(mesh, points, terrain)
            self._renderer.upload_mesh(mesh.id)
        middle = 0.5 * _POLE_M * self.camera.unit
        positions = self.replay.positions(REFERENCE_ROWS, time_s)
        for geom, (x, y) in zip(self._targets, positions, strict=True):
            self.data.geom_xpos[geom] = x, y, float(terrain.height(x, y)) + middle

    def _wheel_paths(self, time_s: float) -> list[FloatArray]:
        """Return the paths of the wheels of `_TRACKS` up to a time, (n, 2) [m] each."""
        motion = self.replay.motion
        xyz, _ = self.replay.poses(time_s)
        passed = self._track_rows[motion.time_s[self._track_rows] < time_s]
        bodies = [self.replay.body(wheel) for wheel in _TRACKS]
        return [np.vstack([motion.xyz[passed, body, :2], xyz[body, :2]]) for body in bodies]

    def _paint_ground(self) -> None:
        """Paint soil, light and stripes into the texture of the field, and match the meadow."""
        texture, ground = self.model.texture("ground"), self.replay.ground
        columns, rows = texture.width[0], texture.height[0]
        colours = ground_colours(ground.terrain, ground.cone_index, rows, columns)
        # the first row of a texture lies at the far side of a height field
        texture.data[:] = (255.0 * mown(colours, ground.terrain)[::-1]).astype(np.uint8)
        self.model.material("meadow").rgba[:3] = colours.mean(axis=(0, 1))

    def _shell_geoms(self) -> NDArray[np.intp]:
        """Return the ids of the vehicle's visible shapes, glass left out."""
        model = self.model
        seen = (model.geom_bodyid > 0) & (model.geom_group < _HIDDEN_GROUP)
        opaque = [
            model.geom_matid[geom] < 0 or model.mat_rgba[model.geom_matid[geom], 3] == 1.0
            for geom in range(model.ngeom)
        ]
        return np.flatnonzero(seen & np.array(opaque))

    def _add_ghost(self, ghost: Ghost, time_s: float) -> None:
        """Add a translucent copy of the vehicle to the scene."""
        model, scene = self.model, self._scene
        xyz, quat = np.zeros((model.nbody, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (model.nbody, 1))
        xyz[self._bodies], quat[self._bodies] = ghost.poses(time_s)
        body = model.geom_bodyid[self._shell]
        attitude = rotation(quat[body])
        places = xyz[body] + attitude.apply(model.geom_pos[self._shell])
        turns = (attitude * rotation(model.geom_quat[self._shell])).as_matrix()
        colour = np.array([*unit_rgb(ghost.colour), _GHOST_OPACITY], np.float32)
        for geom, place, turn in zip(self._shell, places, turns, strict=True):
            shape = scene.geoms[scene.ngeom]
            kind = int(model.geom_type[geom])
            mujoco.mjv_initGeom(shape, kind, model.geom_size[geom], place, turn.ravel(), colour)
            if kind == mujoco.mjtGeom.mjGEOM_MESH:
                shape.dataid = 2 * model.geom_dataid[geom]  # 2i + 1 is the mesh's hull
            shape.category = mujoco.mjtCatBit.mjCAT_DECOR
            scene.ngeom += 1

    def _light(self, middle: FloatArray) -> None:
        """Move the sun with the vehicle, since shadows extend only `_EXTENT_M` around it."""
        self.data.light_xpos[0] = middle - _SUN_AWAY_M * self.camera.unit * np.array(_SUN)
        self.data.light_xdir[0] = np.array(_SUN) / np.linalg.norm(_SUN)

    def close(self) -> None:
        """Free the graphics memory."""
        self._renderer.close()


def _lit(colour: Rgb) -> tuple[float, float, float, float]:
    """Return the colour of a line for which light and emission show the given one."""
    red, green, blue = (part / _LINE_LIGHT for part in unit_rgb(colour))
    return red, green, blue, 1.0


def _camera(view: View) -> mujoco.MjvCamera:
    forward = view.forward
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat = view.target
    camera.distance = float(np.linalg.norm(view.target - view.eye))
    camera.elevation = math.degrees(math.asin(float(np.clip(forward[2], -1.0, 1.0))))
    level = math.hypot(forward[0], forward[1])
    camera.azimuth = 90.0 if level < 1e-9 else math.degrees(math.atan2(forward[1], forward[0]))
    return camera
