"""A command that is held over some physics steps."""

from typing import NamedTuple

from ttempc.types import FloatArray


class HeldCommand(NamedTuple):
    """Command and the state of its path to the servos, for compiled and for plain steps."""

    axes: FloatArray  # rows `VALVE`, none where the command is the set points
    valves: FloatArray  # of `move_valves`, changed in place
    command: FloatArray  # (3,)
    time_s: float  # simulated time at the start
    stride: int  # number of physics steps to each stop
