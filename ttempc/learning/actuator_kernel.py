"""Response of one actuator to recorded commands, compiled."""

from __future__ import annotations

import math
from typing import Final

from ..jit import cached_njit
from ..types import FloatArray

_LONGEST_STEP_S: Final = 0.02  # a seventh of the shortest lag of the paper's vehicle
_SAME_TIME_S: Final = 1e-9


@cached_njit(nogil=True)
def respond(
    starts: FloatArray,
    commands: FloatArray,
    times: FloatArray,
    dead_time: float,
    lag: float,
    play: float,
    rate: float,
    response: FloatArray,
) -> None:
    """Write the output of an actuator at `times` (n,), increasing [s], into `response` (n,).

    The actuator is at rest at the first of the `commands` (m,), which are held from `starts` (m,)
    [s] on. They arrive after the `dead_time` [s]; a play of half width `play` follows them, a set
    point follows the play at the `rate` limit, and the output follows the set point with the `lag`
    [s]. Steps of the integration end where a command arrives, so that the output is continuous in
    all parameters.
    """
    now, output, valve, target = starts[0], commands[0], commands[0], commands[0]
    index, last = 0, len(commands) - 1  # of the command that has arrived
    for n in range(len(times)):
        while now < times[n] - _SAME_TIME_S:
            end = min(times[n], now + _LONGEST_STEP_S)
            while index < last and starts[index + 1] + dead_time <= now + _SAME_TIME_S:
                index += 1
            if index < last:
                end = min(end, starts[index + 1] + dead_time)
            step = end - now
            target = min(max(target, commands[index] - play), commands[index] + play)
            before, way = valve, target - valve
            moving = min(step, abs(way) / rate)  # [s], at the rate limit
            valve = target if moving < step else before + math.copysign(rate * step, way)
            mean = valve + 0.5 * (before - valve) * moving / step
            output = mean + (output - mean) * math.exp(-step / lag)
            now = end
        response[n] = output
