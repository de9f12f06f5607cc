"""Conservation of energy and momentum: free fall, sliding on ground without friction."""

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
    """Check a free fall with spinning wheels and a swinging trailer, without damping or drive."""
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 1.0)
    _remove_losses(plant)
    data = plant.data
    data.qpos[2] += _HEIGHT_M
    for joint, rate in (("rj1_yaw", 0.5), ("rj1_roll", 0.3), ("rj1_pitch", 0.2)):
        data.joint(joint).qvel[0] = rate
    data.qvel[3:6] = 0.1, -0.05, 0.2
    mujoco.mj_step1(plant.model, data)
    energy, momentum, spin = _mechanics(plant)
    data.xfrc_applied[:] = 0.0
    for _ in range(steps(plant, _FALL_S)):  # without the wheel model: no wheel touches the ground
        mujoco.mj_step2(plant.model, data)
        mujoco.mj_step1(plant.model, data)
    energy_after, momentum_after, spin_after = _mechanics(plant)
    mass = plant.model.body_mass.sum()
    fallen = momentum + mass * _FALL_S * plant.model.opt.gravity
    scale = mass * 9.81 * _FALL_S
    return [
        between(
            "momentum drift in free fall of 0.5 s",
            figure=float(np.abs(momentum_after - fallen).max() / scale),
            low=0.0,
            high=1e-3,
            unit="of m g t",
            source="Newton: m v = m g t, whatever the joints do",
        ),
        between(
            "angular momentum drift in free fall of 0.5 s",
            figure=float(np.linalg.norm(spin_after - spin) / np.linalg.norm(spin)),
            low=0.0,
            high=0.01,
            unit="of itself",
            source="Euler: no moment about the centre of mass; 1 % of integration error (assumed)",
        ),
        between(
            "drift of the energy about the centre of mass in free fall of 0.5 s",
            figure=abs(energy_after / energy - 1.0),
            low=0.0,
            high=0.01,
            unit="of itself",
            source="conservation; 1 % of integration error (assumed)",
        ),
    ]


def frictionless(bench: Bench) -> list[Check]:
    """Check a vehicle that slides ahead and aside on the normal forces of its wheels alone."""
    plant = bench.plant(flat((20.0, 20.0)))
    plant.reset(0.0, 0.0, 0.0, 0.0)
    _remove_losses(plant)
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
            figure=float(np.abs(after - momentum)[:2].max()) / scale,
            low=0.0,
            high=1e-3,
            unit="of itself",
            source="Newton: no horizontal force",
        ),
        between(
            "kinetic energy drift on frictionless level ground in 1 s",
            figure=abs(_kinetic(plant) - kinetic) / kinetic,
            low=0.0,
            high=0.005,
            unit="of itself",
            source="conservation; 0.5 % of integration error (assumed)",
        ),
    ]


def _remove_losses(plant: Plant) -> None:
    """Remove drive, damping and friction from the model."""
    model = plant.model
    model.actuator_gainprm[:] = 0.0
    model.actuator_biasprm[:] = 0.0
    model.dof_damping[:] = 0.0
    model.dof_frictionloss[:] = 0.0
    model.geom_friction[:] = 0.0


def _slide(plant: Plant) -> None:
    """Advance one physics step with the normal forces of the wheels alone."""
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

    The energy is that about the centre of mass: the energy of the fall itself has the integrator's
    error dt / t, which is not a property of the model.
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
