"""Wheels on soil for any MuJoCo model.

    import mujoco
    from proving_ground import SoilWheels, Tyre

    wheels = SoilWheels(model, {"left": tyre, "right": tyre}, ground="floor", cone_index_kpa=600.0)
    while data.time < 10.0:
        wheels.apply(model, data)
        mujoco.mj_step(model, data)

The forces are those of `tyre_kernel.wheel_step`, the law of the proving ground's own vehicles;
`SoilLaw` has its equations and sources.

Two ways bring them into a step. `apply` writes them into `xfrc_applied` before a step, or between
`mj_step1` and `mj_step2`: they act over the whole step, with any integrator. `install` adds them to
`qfrc_passive` from MuJoCo's callback of passive forces, for code that calls `mj_step` itself, as
MuJoCo's viewer does. Both take the forces at the beginning of a step, and give the same motion.

Valid for pneumatic tyres at a slip angle and a slip of either sign, at up to 5 m/s, with loads of a
tenth to twice the rated one, cone indices of 150 to 2,000 kPa, flanks of the ground of up to 45
degrees, and time steps of up to 4 ms. A wheel more than 70 degrees from the vertical has no forces.
The ground does not move, and no wheel touches another body.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Self

import mujoco
import numpy as np
import tomli_w
from pydantic.dataclasses import dataclass

from ttempc.suggestion import did_you_mean
from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, StrengthKpa, read_toml, validated
from ..errors import InvalidPlant
from ..foreign_files import read_member
from ..ground.ground import GROUND_FILE, Ground
from ..ground.shapes import ground_of_geom
from ..truth import Wheels
from .hub_kernel import HUB, Hubs, apply_hubs, read_hubs, wheel_bodies
from .soil_law import SoilLaw
from .tyre import Tyre, Tyres
from .wheel_forces import WheelForces

LONGEST_STEP_S: Final = 0.004
"""Longest time step for which the law is stable."""

_DEFAULT_LAW: Final = SoilLaw()
_NO_TREADS: Final = MappingProxyType[str, tuple[float, float, float, float]]({})
_MOST_GROUND_BYTES: Final = 320_000_000  # of an archive of heights and strengths
_EXPLICIT: Final = "Euler, implicit or implicitfast"


@dataclass(frozen=True, kw_only=True, config=STRICT)
class WheelsFile:
    """Content of a file of wheels."""

    tyres: dict[str, Tyre]
    """Tyre of each wheel, by the name of its body or geom."""
    ground: str = ""
    """Geom of the ground, a plane or a height field; empty: `ground.npz` beside the file."""
    cone_index_kpa: StrengthKpa = 600.0
    """Strength of the soil, where the ground is a geom."""
    ruts: bool = False
    """Whether the wheels press the ground."""
    treads_m: dict[str, tuple[float, float, float, float]] = field(default_factory=dict)
    """Deflection of a wheel's tread along, across, in rolling and in boring, at the start and after
    a reset; 0 for a wheel that is not named."""
    law: SoilLaw = field(default=_DEFAULT_LAW)
    """Coefficients of traction, motion resistance and side force."""


class SoilWheels:
    """Tyres on soil in place of MuJoCo's contacts of some wheels.

    The geoms of the wheels' bodies no longer collide: their `contype` and `conaffinity` in `model`
    are set to 0. The state is the deflection of the treads; it belongs to one `MjData`.

    Args:
        model: with a hinge for each wheel, whose axis is the axle.
        tyres: of each wheel, by the name of its body, with the wheel's centre on the hinge's
            anchor, or by the name of a geom, with the centre in the middle of the geom.
        ground: name of a geom of the world, a plane or a height field; or a `Ground`.
        cone_index_kpa: strength of the soil where `ground` is the name of a geom.
        law: coefficients of traction, motion resistance and side force.
        treads_m: deflections of the treads at the start and after a reset, see `WheelsFile`.

    Raises:
        InvalidPlant: a name is unknown, a wheel has no hinge, two wheels share a body, the ground
            is no plane or height field, or the time step is above 4 ms.
        InvalidField: the ground's numbers are out of range.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        tyres: Mapping[str, Tyre],
        *,
        ground: str | Ground,
        cone_index_kpa: float = 600.0,
        law: SoilLaw = _DEFAULT_LAW,
        treads_m: Mapping[str, tuple[float, float, float, float]] = _NO_TREADS,
    ) -> None:
        if not tyres:
            raise InvalidPlant("wheels: got no name, must be the bodies or geoms of the wheels")
        _check_step(model)
        self._model: Final = model
        self.names: Final = tuple(tyres)
        self.tyres: Final = dict(tyres)
        self.law: Final = law
        if isinstance(ground, str):
            ground = ground_of_geom(model, ground, cone_index_kpa)
        self.ground: Final = ground

        self._places: Final = _places(model, self.names)
        for body in self._places["body"].astype(int):
            own = model.geom_bodyid == body
            model.geom_contype[own] = 0
            model.geom_conaffinity[own] = 0

        self._bodies: Final = wheel_bodies(len(self.names))
        self._forces: Final = WheelForces(
            Tyres.of(list(tyres.values())),
            ground,
            law,
            self._bodies,
            np.arange(len(self.names)),
            float(model.opt.timestep),
        )
        self._data: mujoco.MjData | None = None
        self._hubs: Hubs | None = None
        self._instant = _Instant.none()
        self._first_treads: Final = np.zeros_like(self._forces.treads)
        for name, tread in treads_m.items():
            if name not in self.names:
                raise InvalidPlant(f"treads_m: got {name!r}, must be one of the wheels")
            self._first_treads[self.names.index(name)] = tread
        self.reset()

    @classmethod
    def from_file(cls, model: mujoco.MjModel, file: str | Path) -> Self:
        """Return the wheels of a file, as `ttempc mjcf` and `write` make it.

        Raises:
            InvalidPlant: the file cannot be read, or a key is wrong; see the class for the rest.
        """
        file = Path(file)
        content = validated(WheelsFile, read_toml(file, InvalidPlant), InvalidPlant)
        ground: Any = content.ground
        if ground:
            ground = ground_of_geom(model, ground, content.cone_index_kpa)
        else:
            archive = file.with_name(GROUND_FILE)
            try:
                ground = Ground.from_npz(read_member(file.parent, GROUND_FILE, _MOST_GROUND_BYTES))
            except OSError as error:
                raise InvalidPlant(f"{archive}: cannot be read: {error.strerror}") from None
        ground = replace(ground, ruts=content.ruts)
        return cls(model, content.tyres, ground=ground, law=content.law, treads_m=content.treads_m)

    def apply(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Write the forces of the ground into the rows of the wheels' bodies in `xfrc_applied`.

        What stood in these rows is overwritten. Positions and velocities of the bodies are brought
        up to date first. A second call at the same time starts from the same treads; a time before
        that of the last call resets them.

        Raises:
            InvalidPlant: another model or data than before, or a time step above 4 ms.
        """
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_comVel(model, data)
        apply_hubs(self._step(model, data))

    @contextmanager
    def install(self) -> Iterator[None]:
        """Add the forces of the ground to `qfrc_passive` in every step, within a `with` block.

        It sets MuJoCo's callback of passive forces, which all models of a process share; one that
        stood there is called first. Steps of other models have no forces of these wheels.

        Raises:
            InvalidPlant: the integrator takes more than one set of forces a step (RK4).
        """
        if self._model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:
            raise InvalidPlant(f"integrator: got RK4, must be {_EXPLICIT} for passive forces")
        previous = mujoco.get_mjcb_passive()

        def passive(model: mujoco.MjModel, data: mujoco.MjData) -> None:
            if previous is not None:
                previous(model, data)
            if model is self._model:
                self._add_passive(model, data)

        mujoco.set_mjcb_passive(passive)
        try:
            yield
        finally:
            mujoco.set_mjcb_passive(previous)

    def reset(self) -> None:
        """Return to the treads of the start and, with ruts, to untouched ground."""
        self._forces.reset()
        self._forces.treads[:] = self._first_treads
        self._instant = _Instant.none()

    @property
    def report(self) -> Wheels:
        """Load, slip, forces and ground of each wheel at the last call, in the order of `names`."""
        return self._forces.report

    @property
    def state(self) -> FloatArray:
        """Tread deflections, and with ruts the ground: to be saved with MuJoCo's state."""
        return self._forces.state

    def parameters(self) -> WheelsFile:
        """Return tyres and law as the content of a file, whose ground is `ground.npz`."""
        return WheelsFile(tyres=self.tyres, law=self.law)

    def _step(self, model: mujoco.MjModel, data: mujoco.MjData) -> Hubs:
        """Write the wrenches of the present state; positions and velocities are up to date."""
        hubs = self._bind(model, data)
        read_hubs(hubs)
        forces = self._forces
        treads = forces.treads
        if data.time < self._instant.time_s:
            self.reset()
        if data.time != self._instant.time_s:
            self._instant = _Instant(data.time, treads.copy(), np.empty(0))
        motion = np.concatenate([data.qpos, data.qvel])
        if not np.array_equal(motion, self._instant.motion):  # else its wrenches still stand
            treads[:] = self._instant.treads
            self._instant.motion = motion
            forces.step()
        return hubs

    def _add_passive(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._step(model, data)
        bodies = self._bodies
        for wheel, body in enumerate(self._places["body"].astype(int).tolist()):
            mujoco.mj_applyFT(
                model,
                data,
                bodies.wrenches[wheel, :3],
                bodies.wrenches[wheel, 3:],
                bodies.positions[wheel],
                body,
                data.qfrc_passive,
            )

    def _bind(self, model: mujoco.MjModel, data: mujoco.MjData) -> Hubs:
        """Return the views of a data, which is the same in every call."""
        if self._hubs is not None and data is self._data and model is self._model:
            return self._hubs
        if self._data is not None or model is not self._model:
            raise InvalidPlant(
                "wheels: got another model or data, must be those of the first call; "
                "make a SoilWheels for each"
            )
        _check_step(model)
        rows = self._places.view(np.float64).reshape(len(self.names), -1)
        self._data = data
        self._hubs = Hubs.of(rows, data, self._bodies)
        return self._hubs


class _Instant:
    """Time of the last call, and what a second call at that time starts from."""

    def __init__(self, time_s: float, treads: FloatArray, motion: FloatArray) -> None:
        self.time_s = time_s
        self.treads = treads  # (n, 3) before the step
        self.motion = motion  # positions and velocities to which the wrenches belong

    @classmethod
    def none(cls) -> Self:
        """Return the instant before any call."""
        return cls(-np.inf, np.empty(0), np.empty(0))


def write_wheels(parameters: WheelsFile) -> str:
    """Return the text of a file of wheels."""
    content = asdict(parameters)
    for tyre in content["tyres"].values():
        for key in [key for key, value in tyre.items() if value is None]:
            del tyre[key]
    return tomli_w.dumps(content)


def _check_step(model: mujoco.MjModel) -> None:
    step = model.opt.timestep
    if not 0.0 < step <= LONGEST_STEP_S:
        raise InvalidPlant(
            f"option timestep: got {step:g} s, must be above 0, at most {LONGEST_STEP_S:g}"
        )


def _places(model: mujoco.MjModel, names: tuple[str, ...]) -> np.ndarray[Any, Any]:
    """Return the places of wheels on their bodies, (n,) records `HUB`."""
    places = np.zeros(len(names), HUB)
    for place, name in zip(places, names, strict=True):
        body, geom = _find(model, name)
        joints = model.body_jntadr[body] + np.arange(model.body_jntnum[body])
        hinges = joints[model.jnt_type[joints] == mujoco.mjtJoint.mjJNT_HINGE]
        if not hinges.size:
            raise InvalidPlant(f"wheel {name!r}: its body has no hinge, whose axis is the axle")
        # MuJoCo turns a body by its joints in their order: the last one spins the wheel
        spin = hinges[-1]
        place["body"] = body
        place["root"] = model.body_rootid[body]
        place["centre"] = model.jnt_pos[spin] if geom is None else model.geom_pos[geom]
        place["axle"] = model.jnt_axis[spin]
    bodies = places["body"]
    if np.unique(bodies).size < bodies.size:
        raise InvalidPlant(f"wheels: got {', '.join(names)}, must be of a body each")
    return places


def _find(model: mujoco.MjModel, name: str) -> tuple[int, int | None]:
    """Return the body of a wheel, and the geom where the name is that of a geom."""
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if body > 0:
        return body, None
    geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, name)
    if geom >= 0:
        return int(model.geom_bodyid[geom]), geom
    bodies = [model.body(index).name for index in range(1, model.nbody)]
    geoms = [model.geom(index).name for index in range(model.ngeom)]
    known = [each for each in dict.fromkeys([*bodies, *geoms]) if each]
    raise InvalidPlant(
        f"wheel {name!r}: no such body or geom; bodies are {', '.join(filter(None, bodies))}"
        f"{did_you_mean(name, known)}"
    )
