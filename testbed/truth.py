"""Truth: the true state of the vehicle and of its wheels at one moment."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, NamedTuple

import numpy as np

from ttempc.types import FloatArray

WHEELS: Final = (
    *("front_left", "front_right", "rear_left", "rear_right"),
    *("trailer_left", "trailer_right"),
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
    psi_d: float  # [rad] yaw of the drawbar
    beta: float  # [rad] angle at RJ1, psi_t - psi_d on level ground
    delta_t: float  # [rad] steering angle of the front axle (single-track equivalent)
    delta_i: float  # [rad] angle at RJ2, psi_d - psi_i on level ground
    hp: float  # hydrostat position after its lag, fraction 0..1
    speed: float  # [m/s] of the tractor point along the tractor's heading
    lateral_speed: float  # [m/s] of the tractor point to the tractor's left
    yaw_rate_t: float  # [rad/s] of the tractor
    yaw_rate_i: float  # [rad/s] of the trailer
    wheel_speed: float  # [m/s] mean of omega r over the two rear wheels, the encoder's quantity
    set_points: FloatArray  # (3,) of both steering servos [rad] and of the hydrostat
    antennas: FloatArray  # (2, 3) [m] of tractor and trailer, map frame
    wheels: Wheels
    body_xyz: FloatArray  # (n, 3) [m] of every body, order of `Plant.body_names`
    body_quat: FloatArray  # (n, 4) w, x, y, z
    tool: Tool | None = None  # None without an implement


MOTION: Final = (
    *("time_s", "x_t", "y_t", "psi_t", "x_i", "y_i", "psi_i"),
    *("z_t", "pitch_t", "roll_t", "z_i", "pitch_i", "roll_i", "psi_d", "beta"),
    *("delta_t", "delta_i", "hp", "speed", "lateral_speed", "yaw_rate_t", "yaw_rate_i"),
    *("wheel_speed", "delta_t_set_point", "delta_i_set_point", "hp_set_point"),
)
"""Names of the first numbers in a row of `TruthBlock`, with the units of `Truth`."""

TRUTH: Final = np.dtype(
    [
        *((name, np.float64) for name in MOTION),
        ("wheels", np.float64, (len(WHEELS), len(Wheels._fields))),
        ("antennas", np.float64, (2, 3)),
    ]
)
"""Row of `TruthBlock`."""

TOOL: Final = np.dtype([(each.name, np.float64) for each in fields(Tool) if each.type == "float"])
"""Numbers of a `Tool` before its arrays."""


def _columns(first: str, after: str) -> slice:
    """Return the columns of `TRUTH` from a field up to another."""
    places = {str(name): item[1] // 8 for name, item in (TRUTH.fields or {}).items()}
    return slice(places[first], places[after])


TRUTH_SIZE: Final = TRUTH.itemsize // 8
STATE_COLUMNS: Final = _columns("x_t", "wheels")  # `MOTION` without the time, as channel `/state`
TYRE_COLUMNS: Final = _columns("wheels", "antennas")  # fields of `Wheels`, as channel `/tyres`
ANTENNA_COLUMNS: Final = slice(TYRE_COLUMNS.stop, TRUTH_SIZE)
TOOL_SIZE: Final = TOOL.itemsize // 8
TOOL_LOWERED: Final = (TOOL.names or ()).index("lowered")  # column of a tool's row


class TruthBlock(NamedTuple):
    """States of the plant at the stops of a drive; the arrays are the receiver's own."""

    rows: FloatArray  # (n, TRUTH_SIZE) rows `TRUTH`
    poses: FloatArray  # (n, bodies, 7) [m] x, y, z and quaternion w, x, y, z of every body
    # (n, TOOL_SIZE + 3 m) numbers of a `Tool` with m points, then its arrays; (n, 0) without one
    tools: FloatArray

    def truth(self, number: int) -> Truth:
        """Return the view of a row; its arrays are those of the row."""
        row = self.rows[number]
        bodies = self.poses[number]
        tool = self.tools[number]
        motion = dict(zip(MOTION, row[: len(MOTION)].tolist(), strict=True))

        def pose(body: str) -> Pose:
            names = ("x", "y", "z", "psi", "pitch", "roll")
            return Pose(*(motion[f"{name}_{body}"] for name in names))

        return Truth(
            **{name: motion[name] for name in _SCALARS},
            tractor=pose("t"),
            trailer=pose("i"),
            set_points=row[_SET_POINTS],
            antennas=row[ANTENNA_COLUMNS].reshape(2, 3),
            wheels=Wheels(*row[TYRE_COLUMNS].reshape(len(WHEELS), -1).T),
            body_xyz=bodies[:, :3],
            body_quat=bodies[:, 3:],
            tool=_tool_of(tool) if len(tool) else None,
        )


_SET_POINTS: Final = _columns("delta_t_set_point", "wheels")
_SCALARS: Final = tuple(each.name for each in fields(Truth) if each.name in MOTION)


def _tool_of(row: FloatArray) -> Tool:
    x, y, z, behind, lowered, distance = row[:TOOL_SIZE].tolist()
    depth, draft, side = row[TOOL_SIZE:].reshape(3, -1)
    return Tool(x, y, z, behind, lowered, distance, depth, draft, side)
