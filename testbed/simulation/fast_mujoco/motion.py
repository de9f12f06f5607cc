"""Motion of the vehicle by those of MuJoCo's functions that it needs, compiled.

`mj_step` also looks for flexes, sensors, energies, islands and callbacks, factors the inertia twice
and makes the Jacobian of each body on which a force acts; without these a step takes two thirds of
its time. The sums are MuJoCo's: a test holds both to each other. Where a shape may touch the ground
or a joint is at a limit, the constraints are MuJoCo's, too.
"""

# mujoco fills its name space from compiled modules without type information
# pyright: reportAttributeAccessIssue=false

from typing import Final, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from ttempc.jit import FAST, cached_njit
from ttempc.types import FloatArray

from ...bodies import Bodies, row_vector
from ...kernel_options import INLINED, KERNEL
from ...vectors import add, cross, subtract
from .library import (
    mj_com_pos,
    mj_com_vel,
    mj_euler,
    mj_factor_m,
    mj_fwd_actuation,
    mj_fwd_constraint,
    mj_kinematics,
    mj_make_m,
    mj_rne,
    mj_solve_m,
)

EXPLICIT: Final = int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
"""Flag with which `mj_Euler` takes the acceleration as it is; `implicitfast` ignores it."""

_VEHICLE: Final = 1  # body whose subtree is the vehicle
_VELOCITY_GAIN: Final = 2  # place in the bias of an actuator

_kernel = cached_njit(**KERNEL, fastmath=FAST)
_inlined = cached_njit(**INLINED, fastmath=FAST)


class Transmission(NamedTuple):
    """Moment arms of the actuators, a sparse row an actuator."""

    arms: FloatArray  # `actuator_moment`
    counts: NDArray[np.int32]  # (nu,) `moment_rownnz`
    firsts: NDArray[np.int32]  # (nu,) `moment_rowadr`
    dofs: NDArray[np.int32]  # `moment_colind`


class Forces(NamedTuple):
    """Generalised forces, (nv,) each."""

    passive: FloatArray  # `qfrc_passive`
    bias: FloatArray  # `qfrc_bias`
    applied: FloatArray  # `qfrc_applied`
    actuator: FloatArray  # `qfrc_actuator`
    smooth: FloatArray  # `qfrc_smooth`
    constraint: FloatArray  # `qfrc_constraint`


class Dynamics(NamedTuple):
    """Views of MuJoCo's arrays, by which a model moves; they outlive a reset of the data."""

    model: int  # addresses
    data: int
    timestep: float  # [s]
    parents: NDArray[np.int64]  # (nbody,) parent of each body
    dof_bodies: NDArray[np.int64]  # (nv,) body of each degree of freedom
    diagonal: NDArray[np.int64]  # (nv,) places of the inertia's diagonal
    damping: FloatArray  # (nv,) `dof_damping`
    biases: FloatArray  # (nu, 10) `actuator_biasprm`
    force_limits: FloatArray  # (nu, 2) `actuator_forcerange`
    transmission: Transmission
    lengths: FloatArray  # (nu,) `actuator_length`
    speeds: FloatArray  # (nu,) `actuator_velocity`
    actuator_forces: FloatArray  # (nu,) `actuator_force`
    bodies: Bodies
    dof_axes: FloatArray  # (nv, 6) `cdof`
    wrenches: FloatArray  # (nbody, 6) moment and force about the vehicle's centre of mass; work
    qpos: FloatArray
    qvel: FloatArray
    inertia: FloatArray  # `M`
    forces: Forces
    unconstrained: FloatArray  # (nv,) `qacc_smooth`
    acceleration: FloatArray  # (nv,) `qacc`

    @classmethod
    def of(cls, model: mujoco.MjModel, data: mujoco.MjData) -> Self:
        """Return the views of a plant.

        Raises:
            ValueError: the model has forces beyond those of `move`.
        """
        springs = model.jnt_stiffness.any() or model.dof_dampingpoly.any()
        if springs or not model.actuator_forcelimited.all():
            raise ValueError("model: has springs, nonlinear dampers, or an actuator without limits")
        last = model.M_rowadr + model.M_rownnz - 1  # a row of the inertia ends on the diagonal
        return cls(
            model=model._address,
            data=data._address,
            timestep=float(model.opt.timestep),
            parents=model.body_parentid.astype(np.int64),
            dof_bodies=model.dof_bodyid.astype(np.int64),
            diagonal=last.astype(np.int64),
            damping=model.dof_damping,
            biases=model.actuator_biasprm,
            force_limits=model.actuator_forcerange,
            transmission=Transmission(
                arms=data.actuator_moment,
                counts=data.moment_rownnz,
                firsts=data.moment_rowadr,
                dofs=data.moment_colind,
            ),
            lengths=data.actuator_length,
            speeds=data.actuator_velocity,
            actuator_forces=data.actuator_force,
            bodies=Bodies.of(data),
            dof_axes=data.cdof,
            wrenches=np.zeros((model.nbody, 6)),
            qpos=data.qpos,
            qvel=data.qvel,
            inertia=data.M,
            forces=Forces(
                passive=data.qfrc_passive,
                bias=data.qfrc_bias,
                applied=data.qfrc_applied,
                actuator=data.qfrc_actuator,
                smooth=data.qfrc_smooth,
                constraint=data.qfrc_constraint,
            ),
            unconstrained=data.qacc_smooth,
            acceleration=data.qacc,
        )


@_kernel
def update_kinematics(dynamics: Dynamics) -> None:
    """Do as `mj_step1` for a vehicle without constraints: all that follows from the state."""
    mj_kinematics(dynamics.model, dynamics.data)
    mj_com_pos(dynamics.model, dynamics.data)
    mj_make_m(dynamics.model, dynamics.data)
    _write_actuator_motion(dynamics)
    mj_com_vel(dynamics.model, dynamics.data)
    forces = dynamics.forces
    for dof in range(dynamics.qvel.size):
        forces.passive[dof] = -dynamics.damping[dof] * dynamics.qvel[dof]
    mj_rne(dynamics.model, dynamics.data, 0, forces.bias.ctypes.data)


@_inlined
def _write_actuator_motion(dynamics: Dynamics) -> None:
    """Write lengths and speeds of the actuators, which act on joints of one coordinate."""
    transmission = dynamics.transmission
    for actuator in range(dynamics.lengths.size):
        length = 0.0
        speed = 0.0
        first = transmission.firsts[actuator]
        for entry in range(first, first + transmission.counts[actuator]):
            dof = transmission.dofs[entry]
            # the free joint of the vehicle has one position more than velocities
            length += transmission.arms[entry] * dynamics.qpos[dof + 1]
            speed += transmission.arms[entry] * dynamics.qvel[dof]
        dynamics.lengths[actuator] = length
        dynamics.speeds[actuator] = speed


@_kernel
def move(dynamics: Dynamics, unconstrained: bool) -> None:
    """Do as `mj_step2` with `implicitfast`, for a model that has the flag `EXPLICIT`.

    The acceleration is that of the inertia plus the time step times the dampers of joints and of
    actuators within their limits.

    Args:
        dynamics: of the plant; `unconstrained` says that there are no constraints.
        unconstrained: whether there are no constraints.
    """
    model = dynamics.model
    data = dynamics.data
    smooth = dynamics.forces.smooth
    constraint = dynamics.forces.constraint

    mj_fwd_actuation(model, data)
    _write_smooth_forces(dynamics)
    if unconstrained:
        for dof in range(smooth.size):
            constraint[dof] = 0.0
    else:
        mj_solve_m(model, data, dynamics.unconstrained.ctypes.data, smooth.ctypes.data, 1)
        mj_fwd_constraint(model, data)

    # MuJoCo solves for a force in one array: that of the constraints serves for the sum
    _add_dampers_to_inertia(dynamics)
    for dof in range(smooth.size):
        constraint[dof] += smooth[dof]
    mj_factor_m(model, data)
    mj_solve_m(model, data, dynamics.acceleration.ctypes.data, constraint.ctypes.data, 1)
    for dof in range(smooth.size):
        constraint[dof] -= smooth[dof]
    mj_euler(model, data)


@_inlined
def _write_smooth_forces(dynamics: Dynamics) -> None:
    """Write the sum of all forces but those of constraints.

    Wrenches on bodies pass from the leaves to the root, each about the vehicle's centre of mass,
    and a degree of freedom takes the part along its axis.
    """
    bodies = dynamics.bodies
    parents = dynamics.parents
    wrenches = dynamics.wrenches
    centre = row_vector(bodies.subtree_centres, _VEHICLE)
    for body in range(parents.size):
        on_body = bodies.wrenches[body]
        force = (on_body[0], on_body[1], on_body[2])
        moments = on_body[3:]
        arm = subtract(row_vector(bodies.mass_centres, body), centre)
        moment = add((moments[0], moments[1], moments[2]), cross(arm, force))
        for axis in range(3):
            wrenches[body, axis] = moment[axis]
            wrenches[body, 3 + axis] = force[axis]
    for body in range(parents.size - 1, 1, -1):
        for part in range(6):
            wrenches[parents[body], part] += wrenches[body, part]

    forces = dynamics.forces
    for dof in range(forces.smooth.size):
        total = forces.passive[dof] - forces.bias[dof] + forces.applied[dof] + forces.actuator[dof]
        body = dynamics.dof_bodies[dof]
        for part in range(6):
            total += dynamics.dof_axes[dof, part] * wrenches[body, part]
        forces.smooth[dof] = total


@_inlined
def _add_dampers_to_inertia(dynamics: Dynamics) -> None:
    """Add the time step times the dampers to the diagonal of the inertia."""
    inertia = dynamics.inertia
    for dof in range(dynamics.damping.size):
        inertia[dynamics.diagonal[dof]] += dynamics.timestep * dynamics.damping[dof]

    transmission = dynamics.transmission
    for actuator in range(dynamics.actuator_forces.size):
        least = dynamics.force_limits[actuator, 0]
        greatest = dynamics.force_limits[actuator, 1]
        if least < dynamics.actuator_forces[actuator] < greatest:
            gain = -dynamics.biases[actuator, _VELOCITY_GAIN]
            first = transmission.firsts[actuator]
            for entry in range(first, first + transmission.counts[actuator]):
                damper = gain * transmission.arms[entry] * transmission.arms[entry]
                place = dynamics.diagonal[transmission.dofs[entry]]
                inertia[place] += dynamics.timestep * damper
