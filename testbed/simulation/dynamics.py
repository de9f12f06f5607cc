"""Motion of the vehicle by those of MuJoCo's functions that it needs, called by their symbols.

`mj_step` also looks for flexes, sensors, energies, islands and callbacks, factors the inertia twice
and makes the Jacobian of each body on which a force acts; without these a step takes two thirds of
its time. The sums are MuJoCo's: a test holds both to each other. Where a shape may touch the ground
or a joint is at a limit, the constraints are MuJoCo's, too.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from pathlib import Path
from typing import Any, Final

import llvmlite.binding
import mujoco
import numpy as np
from numba import types

from ttempc.jit import FAST, cached_njit

for _pattern in ("libmujoco*.so*", "libmujoco*.dylib", "mujoco.dll"):
    for _library in Path(mujoco.__file__).parent.glob(_pattern):
        # loaded already by `mujoco`: this makes its symbols known to numba
        llvmlite.binding.load_library_permanently(str(_library))

_OF_MODEL_AND_DATA: Final = types.void(types.intp, types.intp)
_bias_of: Final = types.void(types.intp, types.intp, types.intc, types.intp)
_solution_of: Final = types.void(types.intp, types.intp, types.intp, types.intp, types.intc)
all_positions: Final = types.ExternalFunction("mj_step1", _OF_MODEL_AND_DATA)
_kinematics: Final = types.ExternalFunction("mj_kinematics", _OF_MODEL_AND_DATA)
_centres: Final = types.ExternalFunction("mj_comPos", _OF_MODEL_AND_DATA)
_inertia: Final = types.ExternalFunction("mj_makeM", _OF_MODEL_AND_DATA)
_velocities: Final = types.ExternalFunction("mj_comVel", _OF_MODEL_AND_DATA)
_bias: Final = types.ExternalFunction("mj_rne", _bias_of)
_actuation: Final = types.ExternalFunction("mj_fwdActuation", _OF_MODEL_AND_DATA)
_factor: Final = types.ExternalFunction("mj_factorM", _OF_MODEL_AND_DATA)
_solve: Final = types.ExternalFunction("mj_solveM", _solution_of)
_constraint: Final = types.ExternalFunction("mj_fwdConstraint", _OF_MODEL_AND_DATA)
_advance: Final = types.ExternalFunction("mj_Euler", _OF_MODEL_AND_DATA)

EXPLICIT: Final = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
"""Flag with which `mj_Euler` takes the acceleration as it is; `implicitfast` ignores it."""


def dynamics_arguments(model: mujoco.MjModel, data: mujoco.MjData) -> tuple[object, ...]:
    """Return the argument `dynamics` of `move`, views of MuJoCo's arrays.

    Raises:
        ValueError: the model has forces beyond those of `move`.
    """
    springs = model.jnt_stiffness.any() or model.dof_dampingpoly.any()
    if springs or not model.actuator_forcelimited.all():
        raise ValueError("model: has springs, nonlinear dampers, or an actuator without limits")
    last = model.M_rowadr + model.M_rownnz - 1  # a row of the inertia ends on the diagonal
    tree = model.body_parentid, model.dof_bodyid, last
    return (
        tuple(np.ascontiguousarray(each, dtype=np.int64) for each in tree),
        (model.dof_damping, model.actuator_biasprm, model.actuator_forcerange),
        (data.actuator_moment, data.moment_rownnz, data.moment_rowadr, data.moment_colind),
        (data.actuator_length, data.actuator_velocity, data.actuator_force),
        (data.xipos, data.subtree_com, data.cdof, data.xfrc_applied),
        (data.qpos, data.qvel, data.M, np.zeros((model.nbody, 6))),
        (data.qfrc_smooth, data.qfrc_passive, data.qfrc_bias, data.qfrc_applied),
        (data.qfrc_actuator, data.qfrc_constraint, data.qacc_smooth, data.qacc),
    )


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def positions(model: int, data: int, dynamics: tuple[Any, ...]) -> None:
    """Do as `mj_step1` for a vehicle without constraints; `dynamics` as of `move`."""
    _, gains, moments, actuators, _, state, forces, _ = dynamics
    qpos, qvel, _, _ = state
    moment, counts, firsts, columns = moments
    length, velocity, _ = actuators
    _kinematics(model, data)
    _centres(model, data)
    _inertia(model, data)
    for actuator in range(length.size):
        length[actuator] = velocity[actuator] = 0.0
        for entry in range(firsts[actuator], firsts[actuator] + counts[actuator]):
            dof = columns[entry]
            length[actuator] += moment[entry] * qpos[dof + 1]  # a position more: of the free joint
            velocity[actuator] += moment[entry] * qvel[dof]
    _velocities(model, data)
    _, passive, bias, _ = forces
    damping, _, _ = gains
    for dof in range(qvel.size):
        passive[dof] = -damping[dof] * qvel[dof]
    _bias(model, data, 0, bias.ctypes.data)


@cached_njit(error_model="numpy", boundscheck=False, fastmath=FAST)
def move(model: int, data: int, free: bool, timestep: float, dynamics: tuple[Any, ...]) -> None:
    """Do as `mj_step2` with `implicitfast`, for a model that has the flag `EXPLICIT`.

    Forces on bodies pass from the leaves to the root, each a wrench about the vehicle's centre of
    mass, and a degree of freedom takes the part along its axis. The acceleration is that of the
    inertia plus the time step times the dampers of joints and of actuators within their limits.

    Args:
        model, data: addresses.
        free: whether there are no constraints.
        timestep: [s].
        dynamics: of `dynamics_arguments`: parents (nbody,), body of each degree of freedom (nv,),
            places of the diagonal (nv,); gains and limits; the sparse moments; the actuators;
            bodies, with the forces on them; the state, with (nbody, 6) of work; forces.
    """
    tree, gains, moments, actuators, bodies, state, forces, others = dynamics
    parents, body_of, diagonal = tree
    damping, bias_of, limits = gains
    moment, counts, firsts, columns = moments
    _, _, force = actuators
    centres, com, axes, applied = bodies
    _, _, inertia, wrenches = state
    smooth, passive, bias, outside = forces
    actuator_force, constraint, unconstrained, acceleration = others
    _actuation(model, data)
    x, y, z = com[1, 0], com[1, 1], com[1, 2]
    for body in range(parents.size):
        fx, fy, fz = applied[body, 0], applied[body, 1], applied[body, 2]
        rx, ry, rz = centres[body, 0] - x, centres[body, 1] - y, centres[body, 2] - z
        wrenches[body, 0] = applied[body, 3] + ry * fz - rz * fy
        wrenches[body, 1] = applied[body, 4] + rz * fx - rx * fz
        wrenches[body, 2] = applied[body, 5] + rx * fy - ry * fx
        wrenches[body, 3], wrenches[body, 4], wrenches[body, 5] = fx, fy, fz
    for body in range(parents.size - 1, 1, -1):
        for part in range(6):
            wrenches[parents[body], part] += wrenches[body, part]
    for dof in range(smooth.size):
        total = passive[dof] - bias[dof] + outside[dof] + actuator_force[dof]
        for part in range(6):
            total += axes[dof, part] * wrenches[body_of[dof], part]
        smooth[dof] = total
    if free:
        for dof in range(smooth.size):
            constraint[dof] = 0.0
    else:
        _solve(model, data, unconstrained.ctypes.data, smooth.ctypes.data, 1)
        _constraint(model, data)
    for dof in range(smooth.size):
        inertia[diagonal[dof]] += timestep * damping[dof]
        constraint[dof] += smooth[dof]
    for actuator in range(force.size):
        if limits[actuator, 0] < force[actuator] < limits[actuator, 1]:
            for entry in range(firsts[actuator], firsts[actuator] + counts[actuator]):
                damper = -bias_of[actuator, 2] * moment[entry] * moment[entry]
                inertia[diagonal[columns[entry]]] += timestep * damper
    _factor(model, data)
    _solve(model, data, acceleration.ctypes.data, constraint.ctypes.data, 1)
    for dof in range(smooth.size):
        constraint[dof] -= smooth[dof]
    _advance(model, data)
