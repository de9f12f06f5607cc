"""A truth to start from: the vehicle at rest in the middle of a level field."""

from dataclasses import replace

import numpy as np
from proving_ground.testbed.truth import STATE_COLUMNS, Pose, Truth, TruthBlock, Wheels

_LEVEL = Pose(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def truth(tractor=None, trailer=None, **values) -> Truth:
    """Return a truth; `tractor` and `trailer` are changes to a level pose at the origin."""
    zeros = np.zeros(6)
    rest = Truth(
        time_s=0.0,
        tractor=_LEVEL._replace(**(tractor or {})),
        trailer=_LEVEL._replace(**{"x": -2.4, **(trailer or {})}),
        antennas=np.array([[0.0, 0.0, 1.78], [-2.4, 0.0, 1.27]]),
        psi_d=0.0,
        beta=0.0,
        delta_t=0.0,
        delta_i=0.0,
        speed=0.0,
        lateral_speed=0.0,
        yaw_rate_t=0.0,
        yaw_rate_i=0.0,
        wheel_speed=0.0,
        hp=0.0,
        set_points=np.zeros(3),
        wheels=Wheels(*([zeros] * 7)),
        body_xyz=np.zeros((1, 3)),
        body_quat=np.array([[1.0, 0.0, 0.0, 0.0]]),
    )
    return replace(rest, **values)


def state_row(state):
    """Return the row of the channel `/state` of a truth."""
    return moments(state).rows[0, STATE_COLUMNS]


def moments(*truths):
    """Return the rows of which truths are views."""

    def tool_row(tool):
        numbers = (tool.x, tool.y, tool.z, tool.behind, tool.lowered, tool.distance)
        return np.concatenate([numbers, tool.depth, tool.draft, tool.side])

    def row(of):
        motion = (
            *(of.time_s, of.tractor.x, of.tractor.y, of.tractor.yaw),
            *(of.trailer.x, of.trailer.y, of.trailer.yaw),
            *(of.tractor.z, of.tractor.pitch, of.tractor.roll),
            *(of.trailer.z, of.trailer.pitch, of.trailer.roll),
            *(of.psi_d, of.beta, of.delta_t, of.delta_i, of.hp, of.speed, of.lateral_speed),
            *(of.yaw_rate_t, of.yaw_rate_i, of.wheel_speed, *of.set_points.tolist()),
        )
        return np.concatenate([motion, np.transpose(of.wheels).ravel(), of.antennas.ravel()])

    return TruthBlock(
        np.array([row(of) for of in truths]),
        np.array([np.hstack([of.body_xyz, of.body_quat]) for of in truths]),
        np.array([tool_row(of.tool) if of.tool else () for of in truths]),
    )
