"""The scene of a run in MuJoCo: vehicle as logged, field, light, and lines on the ground."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from proving_ground.testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from proving_ground.testbed.truth import WHEELS
from proving_ground.testbed.vehicle.appearance import paint_ground
from ttempc.types import FloatArray

from ..errors import InvalidFilm
from .camera import FIELD_OF_VIEW, Operator, View
from .colours import PLAN, REFERENCE, TRACTOR, TRAILER, slip_colour, unit_rgb
from .field import FieldMesh
from .posing import place_bodies
from .replay import Replay
from .ribbon import MeshView, Ribbon
from .screen import Screen

_HORIZON: Final = (0.80, 0.87, 0.94)  # colour of the sky there, and of what is far away
_SUN: Final = (0.45, -0.45, -0.77)  # from the north-west, where the ground's picture has it
_SUN_AWAY_M: Final = 1.6  # above the roof; farther, the ground shades itself in stripes
_TRAIL_STEP_M: Final = 0.25  # between the points of a driven path
_TARGETS: Final = ("target_tractor", "target_trailer")  # where both points should be
_POLE_M: Final = 2.6  # height: above the roof, whatever hides its foot
_SHADOW_MAP: Final = 1024  # pixels: soft at the distance of a camera, and cheap
_SAMPLES: Final = 4  # a pixel
_EXTENT_M: Final = 4.0  # half of what the shadows cover
_TEXTURE: Final = (2560, 1600)


class Stage:
    """Renders any moment of one run; a body stands where the log says, not where physics would.

    Raises:
        InvalidFilm: the log's model and its transforms are not of one vehicle.
        NoGraphics: there is no OpenGL.
    """

    def __init__(self, replay: Replay, size: tuple[int, int], speed: float) -> None:
        self.replay, self.operator = replay, Operator(replay, speed)
        unit = self.operator.unit
        self._field = FieldMesh(replay.ground.terrain, unit)
        trail = replay.driven(replay.end_s, _TRAIL_STEP_M).shape[1] + 1
        longest_plan = max(
            (len(line.points) for lines in replay.plans for line in lines), default=2
        )
        self._reference = Ribbon("reference", len(replay.path), 0.12 * unit, 0.015)
        self._trails = (
            Ribbon("trail_tractor", trail, 0.09 * unit, 0.020),
            Ribbon("trail_trailer", trail, 0.09 * unit, 0.024),
        )
        self._plans = (
            Ribbon("plan_tractor", longest_plan, 0.12 * unit, 0.030),
            Ribbon("plan_trailer", longest_plan, 0.12 * unit, 0.030),
        )
        self.model = self._compiled()
        self.data = mujoco.MjData(self.model)
        self._meshes = {
            name: MeshView(self.model, name)
            for name in (
                *(FieldMesh.NAME, "meadow", self._reference.name),
                *(ribbon.name for ribbon in (*self._trails, *self._plans)),
            )
        }
        paint_ground(self.model, replay.ground.terrain, replay.ground.cone_index)
        painted = self.model.texture("ground").data.reshape(-1, 3).mean(axis=0)
        self.model.material("meadow").rgba[:3] = painted / 255.0
        self._bodies = self._body_ids()
        self._lugs = [self.model.geom(f"{wheel}_lugs").id for wheel in WHEELS]
        self.model.geom_matid[self._lugs] = -1  # their colour is their own
        self._targets = [self.model.geom(name).id for name in _TARGETS]
        mujoco.mj_kinematics(self.model, self.data)  # what stands still gets its place
        self._field.lay_meadow(self._meshes["meadow"])
        self._reference.lay(self._meshes["reference"], replay.path, replay.ground.terrain)
        self._screen = Screen(self.model, size)
        self._scene = mujoco.MjvScene(self.model, self.model.ngeom + 8)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
        self._options = mujoco.MjvOption()

    def picture(self, camera: str, time_s: float) -> NDArray[np.uint8]:
        """Return what a camera of `camera.VIEWS` sees, (height, width, 3)."""
        self.pose(time_s)
        self._draw_lines(time_s)
        view = self.operator.view(camera, time_s)
        stand = self.operator.stand(time_s)
        if self._field.lay(self._meshes[FieldMesh.NAME], *stand.middle[:2].tolist()):
            self._screen.upload_mesh(self._meshes[FieldMesh.NAME].id)
        self._light(stand.middle)
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self._options,
            None,
            _camera(view),
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        return self._screen.picture(self._scene)

    def pose(self, time_s: float) -> None:
        """Put every body of `data`, and every shape on it, to its logged place."""
        place_bodies(self.model, self.data, self._bodies, *self.replay.poses(time_s))
        slips = self.replay.slips(time_s)
        self.model.geom_rgba[self._lugs, :3] = [unit_rgb(slip_colour(slip)) for slip in slips]

    def _compiled(self) -> mujoco.MjModel:
        """Return the log's model with another ground, another light, and the lines."""
        try:
            spec = mujoco.MjSpec.from_string(self.replay.mjcf)
            for light in list(spec.lights):
                spec.delete(light)
        except ValueError as error:
            raise InvalidFilm(f"{self.replay.file}: its model cannot be read: {error}") from None
        unit, visual = self.operator.unit, spec.visual
        ground = spec.texture("ground")
        ground.width, ground.height = _TEXTURE
        spec.add_material(name="meadow", specular=0.0)
        spec.add_material(name="line", emission=0.35, specular=0.0)
        self._field.add_to(spec)
        self._reference.add_to(spec, (*unit_rgb(REFERENCE), 1.0))
        for ribbon, colour in zip(self._trails, (TRACTOR, TRAILER), strict=True):
            ribbon.add_to(spec, (*unit_rgb(colour), 1.0))
        for ribbon in self._plans:
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
        # Near and far plane, fog and the reach of shadows are multiples of the extent.
        spec.stat.extent = _EXTENT_M * unit
        visual.map.znear, visual.map.zfar = 0.05, 60.0
        visual.map.fogstart, visual.map.fogend = 12.0, 55.0
        visual.map.shadowclip = 1.0
        return spec.compile()

    def _body_ids(self) -> NDArray[np.intp]:
        """Return the model's numbers of the bodies in the order of the log."""
        names = self.replay.motion.body_names
        own = {self.model.body(i).name: i for i in range(self.model.nbody)}
        missing = sorted(set(names) - set(own))
        if missing:
            raise InvalidFilm(
                f"{self.replay.file}: has transforms of {', '.join(missing)}, its model has not"
            )
        return np.array([own[name] for name in names])

    def _draw_lines(self, time_s: float) -> None:
        terrain = self.replay.ground.terrain
        lines = list(zip(self._trails, self.replay.driven(time_s, _TRAIL_STEP_M), strict=True))
        plans = self.replay.plan(time_s) or (np.empty((0, 2)), np.empty((0, 2)))
        lines += zip(self._plans, plans, strict=True)
        for ribbon, points in lines:
            mesh = self._meshes[ribbon.name]
            ribbon.lay(mesh, points, terrain)
            self._screen.upload_mesh(mesh.id)
        middle = 0.5 * _POLE_M * self.operator.unit
        places = self.replay.places(REFERENCE_ROWS, time_s)
        for geom, (x, y) in zip(self._targets, places, strict=True):
            self.data.geom_xpos[geom] = x, y, float(terrain.height(x, y)) + middle

    def _light(self, middle: FloatArray) -> None:
        """Bring the sun along: its shadows reach no farther than the extent about its place."""
        self.data.light_xpos[0] = middle - _SUN_AWAY_M * self.operator.unit * np.array(_SUN)
        self.data.light_xdir[0] = np.array(_SUN) / np.linalg.norm(_SUN)

    def close(self) -> None:
        """Free what the graphics hold."""
        self._screen.close()


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
