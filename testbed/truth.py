"""Truth: the true state of the vehicle and of its wheels at one moment."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from ttempc.types import FloatArray

WHEELS: Final = (
    "front_left",
    "front_right",
    "rear_left",
    "rear_right",
    "trailer_left",
    "trailer_right",
)


class Pose(NamedTuple):
    """Position of a point of a body and the body's attitude (map; yaw, pitch, roll: z, y', x'')."""

    x: float  # [m]
    y: float  # [m]
    z: float  # [m]
    yaw: float  # [rad], wrapped to (-pi, pi]
    pitch: float  # [rad], positive nose down (rotation about +y, left)
    roll: float  # [rad], positive left side up (rotation about +x, forward)


class Wheels(NamedTuple):
    """Forces and slips at each wheel, in the order of `WHEELS`; arrays are (6,)."""

    load: FloatArray  # [N] normal to the ground, never negative
    slip: FloatArray  # (omega r - v) / max(|omega r|, |v|, small), driving positive
    slip_angle: FloatArray  # [rad] angle of the wheel's velocity to its plane
    force_long: FloatArray  # [N] on the vehicle along the wheel's heading on the ground
    force_lat: FloatArray  # [N] on the vehicle to the wheel's left on the ground
    cone_index: FloatArray  # [kPa] of the soil below the wheel
    ground: FloatArray  # [m] height of the ground below the wheel


@dataclass(frozen=True, slots=True)
class Tool:
    """State of an implement; arrays are (n,), its points from right to left."""

    x: float  # [m] tool point: in the middle of the points, at the height of the trailer's axle
    y: float  # [m]
    z: float  # [m]
    behind: float  # [m] distance of the tool point behind the trailer point
    lowered: float  # 1 in working position, 0 raised
    distance: float  # [m] driven by the trailer point
    depth: FloatArray  # [m] below the ground
    draft: FloatArray  # [N] backward on the trailer
    side: FloatArray  # [N] on the trailer, to its left


@dataclass(frozen=True, slots=True)
class Truth:
    """State of the plant at one moment. Points are axle centres; angles: docs/architecture.md."""

    time_s: float
    tractor: Pose  # of the tractor point (centre of the rear axle)
    trailer: Pose  # of the trailer point (centre of the trailer axle)
    antennas: FloatArray  # (2, 3) [m] of tractor and trailer, map frame
    psi_d: float  # [rad] yaw of the drawbar
    beta: float  # [rad] angle at RJ1, psi_t - psi_d on level ground
    delta_t: float  # [rad] steering angle of the front axle (single-track equivalent)
    delta_i: float  # [rad] angle at RJ2, psi_d - psi_i on level ground
    speed: float  # [m/s] of the tractor point along the tractor's heading
    lateral_speed: float  # [m/s] of the tractor point to the tractor's left
    yaw_rate_t: float  # [rad/s] of the tractor
    yaw_rate_i: float  # [rad/s] of the trailer
    rim_speed: float  # [m/s] mean of omega r over the two rear wheels, the encoder's quantity
    hp: float  # hydrostat position after its lag, fraction 0..1
    set_points: FloatArray  # (3,) of both steering servos [rad] and of the hydrostat
    wheels: Wheels
    body_xyz: FloatArray  # (n, 3) [m] of every body, order of `Plant.body_names`
    body_quat: FloatArray  # (n, 4) w, x, y, z
    tool: Tool | None = None  # None without an implement


TRUTH: Final = np.dtype(
    [
        ("time_s", "f8"),
        ("state", "f8", 25),  # as a row of the channel `/state`
        ("tyres", "f8", (6, 7)),  # as a row of the channel `/tyres`: wheels, fields of `Wheels`
        ("antennas", "f8", (2, 3)),
    ]
)
"""Record of a moment that compiled steps write, a row of float64; `Truth` is its view."""
