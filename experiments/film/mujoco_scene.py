"""MuJoCo scene of a run: vehicle as logged, field, light, and lines on the ground."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from proving_ground.testbed.errors import first_line
from proving_ground.testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from proving_ground.testbed.truth import WHEELS
from proving_ground.testbed.vehicle.appearance import paint_ground
from ttempc.types import FloatArray

from ..errors import InvalidFilm
from .body_poses import place_bodies
from .camera import FIELD_OF_VIEW, FollowCamera, View
from .colours import PLAN, REFERENCE, TRACTOR, TRAILER, slip_colour, unit_rgb
from .field import FieldMesh
from .offscreen import OffscreenRenderer
from .replay import Replay
from .ribbon import MeshView, Ribbon

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
_SHADOW_MAP: Final = 1024  # pixels; coarse, hence soft and fast
_SAMPLES: Final = 4  # per pixel
_EXTENT_M: Final = 4.0  # half the side of the area with shadows
_TEXTURE: Final = (2560, 1600)  # pixels of the ground, width and height


class MujocoScene:
    """Renderer of one run at any time, with the bodies at their logged poses.

    Args:
        replay: the run.
        size: width and height of a picture [pixels].
        speed: seconds of the run per second of film.

    Raises:
        InvalidFilm: the log's model and its transforms have different bodies.
        NoGraphics: OpenGL is unavailable.
    """

    def __init__(self, replay: Replay, size: tuple[int, int], speed: float) -> None:
        self.replay, self.camera = replay, FollowCamera(replay, speed)
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
        self.model = self._compiled()
        self.data = mujoco.MjData(self.model)
        ribbons = (self._reference, *self._trails, *self._predictions)
        meshes = [FieldMesh.NAME, "meadow", *(ribbon.name for ribbon in ribbons)]
        self._meshes = {name: MeshView(self.model, name) for name in meshes}
        paint_ground(self.model, replay.ground.terrain, replay.ground.cone_index)
        painted = self.model.texture("ground").data.reshape(-1, 3).mean(axis=0)
        self.model.material("meadow").rgba[:3] = painted / 255.0
        self._bodies = self._body_ids()
        self._lugs = [self.model.geom(f"{wheel}_lugs").id for wheel in WHEELS]
        self.model.geom_matid[self._lugs] = -1  # no material: the colour shows the slip
        self._targets = [self.model.geom(name).id for name in _TARGETS]
        mujoco.mj_kinematics(self.model, self.data)  # poses of the static geoms
        self._field.lay_meadow(self._meshes["meadow"])
        self._reference.lay(self._meshes["reference"], replay.path, replay.ground.terrain)
        self._renderer = OffscreenRenderer(self.model, size)
        self._scene = mujoco.MjvScene(self.model, self.model.ngeom + 8)
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
        spec.add_material(name="line", emission=0.35, specular=0.0)
        self._field.add_to(spec)
        self._reference.add_to(spec, (*unit_rgb(REFERENCE), 1.0))
        for ribbon, colour in zip(self._trails, (TRACTOR, TRAILER), strict=True):
            ribbon.add_to(spec, (*unit_rgb(colour), 1.0))
        for ribbon in self._predictions:
            ribbon.add_to(spec, (*unit_rgb(PLAN), 1.0))
        for name, colour in zip(_TARGETS, (TRACTOR, TRAILER), strict=True):
            spec.worldbody.add_geom(
                name=name,
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                size=[0.018 * unit, 0.5 * _POLE_M * unit, 0.0],
                rgba=(*unit_rgb(colour), 1.0),
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
        visual.quality.shadowsize, visual.quality.offsamples = _SHADOW_MAP, _SAMPLES
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
        lines = list(zip(self._trails, self.replay.driven(time_s, _TRAIL_STEP_M), strict=True))
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

    def _light(self, middle: FloatArray) -> None:
        """Move the sun with the vehicle, since shadows extend only `_EXTENT_M` around it."""
        self.data.light_xpos[0] = middle - _SUN_AWAY_M * self.camera.unit * np.array(_SUN)
        self.data.light_xdir[0] = np.array(_SUN) / np.linalg.norm(_SUN)

    def close(self) -> None:
        """Free the graphics memory."""
        self._renderer.close()


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
