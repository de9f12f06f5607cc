"""MuJoCo scene of a run: vehicle as logged, field, light, and lines on the ground."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

import math
from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.types import FloatArray

from ....testbed.errors import first_line
from ....testbed.ground.terrain import Terrain
from ....testbed.recording.channels import REFERENCE as REFERENCE_ROWS
from ....testbed.truth import WHEELS
from ....testbed.vehicle.appearance import ground_colours
from ....testbed.viewers.off_screen import graphics_context, off_screen_renderer, rendered
from ...errors import InvalidFilm
from .camera import FIELD_OF_VIEW, FollowCamera
from .drawing import PLAN, POINTS, REFERENCE, Rgb, slip_colour
from .playback import Ghost, Playback, Poses, rotation
from .settings import FilmSettings

_HORIZON: Final = (0.80, 0.87, 0.94)  # colour of the sky at the horizon, and of the fog
_SUN: Final = (0.45, -0.45, -0.77)  # direction of light: from the north-west, as in the texture
_SUN_AWAY_M: Final = 1.6  # distance of the light; farther away, shadow acne appears on the ground
_STEP_M: Final = 0.25  # between the points of a line
_POLE_M: Final = 2.6  # height, above the roof so that the top is always visible
_SHADOW_MAP: Final = 2048  # side of the shadow map [pixels]
_SAMPLES: Final = 4  # samples of a pixel, against jagged edges
_EMISSION = 1.5  # emission of a line on the ground
_LIGHT = 2.5  # with sky and sun on level ground
_HIDDEN_GROUP: Final = 3  # shapes of this group and above serve contacts and are not drawn
_GHOST_OPACITY: Final = 0.30
_GHOST_NEAR_M: Final = 0.08
_EXTENT_M: Final = 4.0  # half the side of the area with shadows
_TEXTURE: Final = (2560, 1600)  # pixels of the ground, width and height
_MOST_CELLS: Final = 90_000  # of the drawn ground: every 0.2 m on 80 x 50 m; that of the simulation
# has nine times as many, and a picture takes four times as long
_MOST_LINES: Final = 60_000  # pieces of all paths, 15 km
_MEADOW_BELOW_M: Final = 0.02


class MujocoScene:
    """Renderer of one run at any time, with the bodies at their logged poses.

    Raises:
        InvalidFilm: the log's model and its transforms have different bodies.
        NoGraphics: OpenGL is unavailable.
    """

    def __init__(
        self,
        playback: Playback,
        settings: FilmSettings,
        size: tuple[int, int],
        ghosts: Sequence[Ghost] = (),
    ) -> None:
        self._playback = playback
        self.camera = FollowCamera(playback, settings.speed)
        self._ghosts = ghosts
        self._size = size
        self._terrain = _drawn(playback.ground.terrain)
        self.model = model = self._compiled()
        self.data = mujoco.MjData(model)
        self._paint_ground()
        try:
            self._bodies = np.array([model.body(name).id for name in playback.motion.body_names])
        except KeyError as error:
            raise InvalidFilm(f"{playback.file}: {first_line(error)}") from None
        self._row = np.zeros(model.nbody, np.intp)  # of a body in the log
        self._row[self._bodies] = np.arange(len(self._bodies))
        self._moving = np.flatnonzero(np.isin(model.geom_bodyid, self._bodies))
        material = model.geom_matid[self._moving]
        opaque = (material < 0) | (model.mat_rgba[material, 3] == 1.0)  # without glass
        self._shell = self._moving[opaque & (model.geom_group[self._moving] < _HIDDEN_GROUP)]
        self._lugs = [model.geom(f"{wheel}_lugs").id for wheel in WHEELS]
        model.geom_matid[self._lugs] = -1  # no material: the colour shows the slip
        mujoco.mj_kinematics(model, self.data)  # poses of the static geoms
        self._gl = graphics_context()
        model.vis.global_.offwidth, model.vis.global_.offheight = size
        self._renderer = off_screen_renderer(model)
        self._scene = mujoco.MjvScene(model, model.ngeom * (1 + len(ghosts)) + _MOST_LINES)
        self._scene.flags[mujoco.mjtRndFlag.mjRND_FOG] = 1
        self._options = mujoco.MjvOption()
        self._options.sitegroup[:] = 0  # a playback moves bodies only: sites would stay behind

    def picture(self, camera: str, time_s: float) -> NDArray[np.uint8]:
        """Return the picture of a named camera, see `camera.py`, at a time, (height, width, 3)."""
        self._gl.make_current()
        poses = self._playback.poses(time_s)
        self.data.xpos[self._bodies], self.data.xquat[self._bodies] = poses
        places, turns = self._geom_poses(self._moving, poses)
        self.data.geom_xpos[self._moving] = places
        self.data.geom_xmat[self._moving] = turns
        slips = self._playback.slips(time_s)
        self.model.geom_rgba[self._lugs, :3] = [_unit(slip_colour(slip)) for slip in slips]
        middle = self.camera.middle(time_s)
        # The sun moves with the vehicle, since shadows extend only `_EXTENT_M` around it.
        self.data.light_xpos[0] = middle - _SUN_AWAY_M * self.camera.unit * np.array(_SUN)
        self.data.light_xdir[0] = np.array(_SUN) / np.linalg.norm(_SUN)
        mujoco.mjv_updateScene(
            self.model,
            self.data,
            self._options,
            None,
            _camera(*self.camera.view(camera, time_s)),
            mujoco.mjtCatBit.mjCAT_ALL.value,
            self._scene,
        )
        self._add_lines(time_s)
        for ghost in self._ghosts:
            self._add_ghost(ghost.poses(time_s), poses, ghost.colour)
        return rendered(self._scene, self._renderer, self._size)

    def _compiled(self) -> mujoco.MjModel:
        """Return the log's model with the ground and light of a film."""
        try:
            spec = mujoco.MjSpec.from_string(self._playback.mjcf)
            for light in list(spec.lights):
                spec.delete(light)
            return self._dressed(spec).compile()
        except (ValueError, KeyError, AttributeError) as error:
            raise InvalidFilm(
                f"{self._playback.file}: its model cannot be used: {first_line(error)}"
            ) from None

    def _dressed(self, spec: mujoco.MjSpec) -> mujoco.MjSpec:
        """Add ground and light of a film to a model."""
        unit = self.camera.unit
        visual = spec.visual
        ground = spec.texture("ground")
        ground.width, ground.height = _TEXTURE
        self._add_field(spec)
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
        visual.quality.shadowsize = _SHADOW_MAP
        visual.quality.offsamples = _SAMPLES
        # Clipping planes, fog and shadow distance are multiples of the extent.
        spec.stat.extent = _EXTENT_M * unit
        visual.map.znear = 0.05
        visual.map.zfar = 60.0
        visual.map.fogstart = 12.0
        visual.map.fogend = 55.0
        visual.map.shadowclip = 1.0
        return spec

    def _add_field(self, spec: mujoco.MjSpec) -> None:
        """Replace the ground of the simulation by a coarser one, and a meadow around it."""
        terrain = self._terrain
        heights = self._terrain.heights
        x0, y0 = terrain.origin
        width, depth = terrain.size_m
        middle = (x0 + 0.5 * width, y0 + 0.5 * depth)
        low = float(heights.min())
        field = spec.hfield("ground")
        span = max(float(np.ptp(heights)), 1e-6)
        field.nrow, field.ncol = heights.shape
        field.size = [0.5 * width, 0.5 * depth, span, 0.01]
        field.userdata = ((heights - low) / span).ravel()
        spec.geom("ground").pos = [*middle, low]
        spec.add_material(name="meadow", specular=0.0)
        spec.worldbody.add_geom(
            name="meadow",
            type=mujoco.mjtGeom.mjGEOM_PLANE,
            size=[0.0, 0.0, 1.0],  # MuJoCo draws a plane of size 0 without end
            pos=[*middle, low - _MEADOW_BELOW_M],
            material="meadow",
        )

    def _paint_ground(self) -> None:
        """Paint soil and relief into the texture of the field, and match the meadow."""
        texture = self.model.texture("ground")
        ground = self._playback.ground
        columns = texture.width[0]
        rows = texture.height[0]
        colours = ground_colours(ground.terrain, ground.cone_index, rows, columns)
        # the first row of a texture lies at the far side of a height field
        texture.data[:] = (255.0 * colours[::-1]).astype(np.uint8)
        self.model.material("meadow").rgba[:3] = colours.mean(axis=(0, 1))

    def _geom_poses(self, geoms: NDArray[np.intp], poses: Poses) -> tuple[FloatArray, FloatArray]:
        """Return positions (n, 3) [m] and rotations (n, 9) of geoms on bodies at poses."""
        model = self.model
        row = self._row[model.geom_bodyid[geoms]]
        attitude = rotation(poses[1][row])
        places = poses[0][row] + attitude.apply(model.geom_pos[geoms])
        turns = (attitude * rotation(model.geom_quat[geoms])).as_matrix()
        return places, turns.reshape(-1, 9)

    def _add_lines(self, time_s: float) -> None:
        """Add paths, and the poles on the references of both points."""
        playback = self._playback
        unit = self.camera.unit
        self._add_line(playback.path, 0.12 * unit, 0.010, _lit(REFERENCE))
        driven = playback.driven(time_s, _STEP_M)
        for point, line, lift in zip(("tractor", "trailer"), driven, (0.014, 0.018), strict=True):
            self._add_line(line, 0.09 * unit, lift, _lit(POINTS[point]))
        for line in playback.predicted_paths(time_s):
            self._add_line(line, 0.12 * unit, 0.024, _lit(PLAN))
        size = [0.018 * unit, 0.5 * _POLE_M * unit, 0.0]
        upright = np.eye(3).ravel()
        due = playback.positions(REFERENCE_ROWS, time_s)
        for point, (x, y) in zip(("tractor", "trailer"), due, strict=True):
            place = [x, y, float(self._terrain.height(x, y)) + size[1]]
            self._add_geom(mujoco.mjtGeom.mjGEOM_CAPSULE, size, place, upright, _lit(POINTS[point]))

    def _add_line(
        self, points: FloatArray, width_m: float, lift_m: float, colour: Sequence[float]
    ) -> None:
        """Add a line through points (n, 2) [m], flat boxes that lie on the ground."""
        height = self._terrain.height(points[:, 0], points[:, 1])
        places = np.column_stack([points, height + lift_m])
        steps = np.diff(places, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        kept = lengths > 1e-6
        along = steps[kept] / lengths[kept, None]
        across = np.cross([0.0, 0.0, 1.0], along)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        turns = np.stack([along, across, np.cross(along, across)], axis=2).reshape(-1, 9)
        middles = (0.5 * (places[1:] + places[:-1]))[kept]
        overlap = 0.1 * width_m  # closes the outer side of a bend
        for length, middle, turn in zip(lengths[kept].tolist(), middles, turns, strict=True):
            size = [0.5 * length + overlap, 0.5 * width_m, 0.002]
            self._add_geom(mujoco.mjtGeom.mjGEOM_BOX, size, middle, turn, colour)

    def _add_ghost(self, ghost: Poses, vehicle: Poses, colour: Rgb) -> None:
        """Add a translucent copy of the vehicle, unless it would only tint the vehicle."""
        points = [self._playback.body(name) for name in ("tractor", "trailer")]
        if np.abs((ghost[0] - vehicle[0])[points]).max() < _GHOST_NEAR_M:
            return
        rgba = (*_unit(colour), _GHOST_OPACITY)
        places, turns = self._geom_poses(self._shell, ghost)
        for geom, place, turn in zip(self._shell, places, turns, strict=True):
            kind = int(self.model.geom_type[geom])
            shape = self._add_geom(kind, self.model.geom_size[geom], place, turn, rgba, 0.0)
            if kind == mujoco.mjtGeom.mjGEOM_MESH:
                shape.dataid = 2 * self.model.geom_dataid[geom]  # 2i + 1 is the mesh's hull

    def _add_geom(
        self,
        kind: int,
        size: Sequence[float],
        place: FloatArray | Sequence[float],
        turn: FloatArray,
        rgba: Sequence[float],
        emission: float = _EMISSION,
    ) -> mujoco.MjvGeom:
        """Add a shape to the scene of this frame, and return it."""
        shape = self._scene.geoms[self._scene.ngeom]
        mujoco.mjv_initGeom(shape, int(kind), size, place, turn, np.array(rgba, np.float32))
        shape.category = mujoco.mjtCatBit.mjCAT_DECOR
        shape.emission = emission
        shape.specular = 0.0
        self._scene.ngeom += 1
        return shape


def _unit(colour: Rgb) -> tuple[float, float, float]:
    """Return a colour in fractions of 1, as in OpenGL."""
    red, green, blue = colour
    return red / 255.0, green / 255.0, blue / 255.0


def _lit(colour: Rgb) -> tuple[float, float, float, float]:
    """Return the colour of a line for which light and emission show the given one."""
    red, green, blue = (part / _LIGHT for part in _unit(colour))
    return red, green, blue, 1.0


def _drawn(terrain: Terrain) -> Terrain:
    """Return the terrain on a coarser grid, on which ground and lines are drawn."""
    ny, nx = terrain.heights.shape
    stride = max(1, math.ceil(math.sqrt(nx * ny / _MOST_CELLS)))
    spacing = stride * terrain.spacing_m
    return Terrain(terrain.heights[::stride, ::stride], spacing, terrain.origin)


def _camera(eye: FloatArray, target: FloatArray) -> mujoco.MjvCamera:
    """Return the free camera of MuJoCo at an eye with a target in the middle of its picture."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_FREE
    camera.lookat = target
    camera.distance = float(np.linalg.norm(target - eye))
    camera.elevation = math.degrees(math.asin(float(np.clip(forward[2], -1.0, 1.0))))
    level = math.hypot(forward[0], forward[1])
    camera.azimuth = 90.0 if level < 1e-9 else math.degrees(math.atan2(forward[1], forward[0]))
    return camera
