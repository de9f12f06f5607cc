"""Law of a wheel on soil in numpy, of n wheels at once: the twin of the compiled law.

Equations are those of `proving_ground.testbed.wheels.tyre_kernel`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.wheels.soil_law import SoilLaw
from proving_ground.testbed.wheels.tyre import (
    LEAST_UPRIGHT,
    SMALL_SPEED,
    Tyres,
    WheelMotion,
    contact,
    mobility,
)

from ttempc.types import FloatArray


@dataclass(frozen=True, slots=True)
class WheelForces:
    """Forces of the ground on n wheels, and the quantities that determine them."""

    force: FloatArray  # (n, 3) [N] on the wheel, map frame
    moment: FloatArray  # (n, 3) [N m] about the wheel's centre
    load: FloatArray  # (n,) [N]
    slip: FloatArray  # (n,)
    slip_angle: FloatArray  # (n,) [rad]
    force_long: FloatArray  # (n,) [N]
    force_lat: FloatArray  # (n,) [N]
    cone_index: FloatArray  # (n,) [kPa]
    ground: FloatArray  # (n,) [m]


def step(
    law: SoilLaw,
    tyres: Tyres,
    terrain: Terrain,
    cone_index: FloatArray,
    motion: WheelMotion,
    deflection: FloatArray,
    dt: float,
    in_track: np.ndarray | bool = False,
) -> tuple[FloatArray, WheelForces]:
    """Return the tread deflections (n, 3) after `dt` [s] and the forces of the ground."""
    ground = terrain.height(motion.centre[:, 0], motion.centre[:, 1])
    touch = contact(tyres, terrain, motion)
    load, normal = touch.load, touch.normal
    ahead = np.cross(motion.axle, normal)
    ahead = ahead / np.maximum(np.linalg.norm(ahead, axis=1), LEAST_UPRIGHT)[:, None]
    left = np.cross(normal, ahead)
    arm = touch.point - motion.centre
    v_long = np.einsum("nk,nk->n", motion.velocity, ahead)
    sliding = motion.velocity + np.cross(motion.rotation, arm)
    v_lat = np.einsum("nk,nk->n", sliding, left)
    rim = tyres.radius * np.einsum("nk,nk->n", motion.rotation, motion.axle)
    rolling = np.maximum(np.abs(rim), np.abs(v_long))

    speeds = np.stack([rim - v_long, v_lat, v_long], axis=1)  # (n, 3) w
    travel = np.maximum(np.abs(v_long), np.abs(rim - v_long))
    carried = np.stack([rolling, travel, np.abs(v_long)], axis=1)  # (n, 3) |V|
    lengths = np.array([law.relaxation_long_m, law.relaxation_lat_m, law.relaxation_roll_m])
    damping = np.array([law.damping_long_s, law.damping_lat_s, law.damping_roll_s])
    after = (deflection + dt * speeds) / (1.0 + dt * carried / lengths)  # implicit Euler
    after = np.clip(after, -lengths, lengths)
    rate = (after - deflection) / dt
    slips = np.clip((after + damping * rate) / lengths, -1.0, 1.0)  # (n, 3)
    after = after * (load > 0.0)[:, None]

    bn, m = mobility(law, tyres, load, cone_index)
    firmer = np.where(in_track, law.second_pass_traction, 1.0)
    freer = np.where(in_track, law.second_pass_resistance, 1.0)
    traction, side = law.combined_ratios(bn, m, slips[:, 0], np.arctan(slips[:, 1]))
    traction = firmer * traction
    torque = traction + freer * law.resistance_tyre * slips[:, 2]
    driving = slips[:, 0] * slips[:, 2]  # slip in the direction of travel
    pull = traction - freer * law.soil_resistance_ratio(bn, driving) * slips[:, 2]
    # friction ellipse: the resistance of the soil is one of its forces, also under a braked wheel
    used = np.hypot(
        pull / (firmer * law.largest_traction_ratio(bn)), side / law.largest_side_ratio(m)
    )
    share = load / np.maximum(1.0, used)
    pull, side = share * pull, share * side

    force = load[:, None] * normal + pull[:, None] * ahead + side[:, None] * left
    moment = np.cross(arm, force)
    # the moment about the axle is that of traction and tyre; the soil's resistance acts on the hub
    about_axle = np.einsum("nk,nk->n", moment, motion.axle)
    moment = moment - (tyres.radius * load * torque + about_axle)[:, None] * motion.axle
    return after, WheelForces(
        force=force,
        moment=moment,
        load=load,
        slip=(rim - v_long) / np.maximum(rolling, SMALL_SPEED),
        slip_angle=np.arctan2(v_lat, np.maximum(np.abs(v_long), SMALL_SPEED)),
        force_long=pull,
        force_lat=side,
        cone_index=cone_index,
        ground=ground,
    )
