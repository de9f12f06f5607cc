"""Energy and momentum of the model in free fall, and sliding on ground without friction."""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import Final

import mujoco
import numpy as np

from ttempc.types import FloatArray

from ..ground.terrain import flat
from ..simulation.plant import Plant
from ..truth import WHEELS
from ..wheels import tyre
from .bench import Bench, steps, wheel_motion
from .check import Check, between

_FALL_S: Final = 0.5
_HEIGHT_M: Final = 5.0  # above the ground, more than it falls
_SLIDE_S: Final = 1.0


def free_fall(bench: Bench) -> list[Check]:
    """A vehicle with spinning wheels and a swinging trailer falls, nothing damps or drives it."""
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 1.0)
    _let_go(plant)
    data = plant.data
    data.qpos[2] += _HEIGHT_M
    for joint, rate in (("rj1_yaw", 0.5), ("rj1_roll", 0.3), ("rj1_pitch", 0.2)):
        data.joint(joint).qvel[0] = rate
    data.qvel[3:6] = 0.1, -0.05, 0.2
    mujoco.mj_step1(plant.model, data)
    energy, momentum, spin = _mechanics(plant)
    data.xfrc_applied[:] = 0.0
    for _ in range(steps(plant, _FALL_S)):  # no wheel model has a say in the air
        mujoco.mj_step2(plant.model, data)
        mujoco.mj_step1(plant.model, data)
    energy_after, momentum_after, spin_after = _mechanics(plant)
    mass = plant.model.body_mass.sum()
    fallen = momentum + mass * _FALL_S * plant.model.opt.gravity
    scale = mass * 9.81 * _FALL_S
    return [
        between(
            "momentum drift in free fall of 0.5 s",
            *(float(np.abs(momentum_after - fallen).max() / scale), 0.0, 1e-3, "of m g t"),
            "Newton: m v = m g t, whatever the joints do",
        ),
        between(
            "angular momentum drift in free fall of 0.5 s",
            float(np.linalg.norm(spin_after - spin) / np.linalg.norm(spin)),
            *(0.0, 0.01, "of itself"),
            "Euler: no moment about the centre of mass; 1 % of integration error (assumed)",
        ),
        between(
            "drift of the energy about the centre of mass in free fall of 0.5 s",
            *(abs(energy_after / energy - 1.0), 0.0, 0.01, "of itself"),
            "conservation; 1 % of integration error (assumed)",
        ),
    ]


def frictionless(bench: Bench) -> list[Check]:
    """The standing vehicle, pushed ahead and aside, slides on its wheels' normal forces alone."""
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    _let_go(plant)
    plant.data.qvel[:2] += 1.0, 0.5
    mujoco.mj_step1(plant.model, plant.data)
    _, momentum, _ = _mechanics(plant)
    kinetic = _kinetic(plant)
    for _ in range(steps(plant, _SLIDE_S)):
        _slide(plant)
    _, after, _ = _mechanics(plant)
    scale = float(np.linalg.norm(momentum[:2]))
    return [
        between(
            "momentum drift on frictionless level ground in 1 s",
            *(float(np.abs(after - momentum)[:2].max()) / scale, 0.0, 1e-3, "of itself"),
            "Newton: no horizontal force",
        ),
        between(
            "kinetic energy drift on frictionless level ground in 1 s",
            *(abs(_kinetic(plant) - kinetic) / kinetic, 0.0, 0.005, "of itself"),
            "conservation; 0.5 % of integration error (assumed)",
        ),
    ]


def _let_go(plant: Plant) -> None:
    """Take away what drives or damps the joints."""
    model = plant.model
    model.actuator_gainprm[:] = 0.0
    model.actuator_biasprm[:] = 0.0
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.geom_friction[:] = 0.0


def _slide(plant: Plant) -> None:
    """Take one step on the normal forces of the wheels alone."""
    model, data = plant.model, plant.data
    if plant.wheels.follows_soil_law:
        ids = np.array([plant.body_names.index(wheel) for wheel in WHEELS])
        motion = wheel_motion(plant)
        touch = tyre.contact(plant.tyres, plant.terrain, motion)
        force = touch.load[:, None] * touch.normal
        data.xfrc_applied[ids, :3] = force
        data.xfrc_applied[ids, 3:] = np.cross(touch.point - motion.centre, force)
    mujoco.mj_step2(model, data)
    mujoco.mj_step1(model, data)


def _mechanics(plant: Plant) -> tuple[float, FloatArray, FloatArray]:
    """Return kinetic energy [J] about the centre of mass, momentum [N s], angular momentum [N m s].

    About the centre of mass, because the energy of the fall itself carries the integrator's
    dt / t, which is no property of the model.
    """
    model, data = plant.model, plant.data
    mujoco.mj_subtreeVel(model, data)
    mass = float(model.body_mass.sum())
    momentum = mass * data.subtree_linvel[1].copy()
    energy = _kinetic(plant) - 0.5 * float(momentum @ momentum) / mass
    return energy, momentum, data.subtree_angmom[1].copy()


def _kinetic(plant: Plant) -> float:
    mujoco.mj_energyVel(plant.model, plant.data)
    return float(plant.data.energy[1])
