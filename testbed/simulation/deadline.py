"""Deadline of a control step: commands that come late, and steps that never return."""

import signal
import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

from ttempc.types import Command

STEP_LIMIT_S: Final = 60.0
"""Wall-clock time after which a call of the guidance is ended; assumed: 300 control periods."""


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Raise `TimeoutError` in the block if it takes longer, by an alarm of the operating system.

    Python runs the alarm's handler between two of its instructions in the main thread. In another
    thread there is no limit, and compiled code that does not return cannot be ended so. Limits are
    not nested.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def expire(number: int, frame: FrameType | None) -> None:
        raise TimeoutError(f"did not return within {seconds:g} s")

    before = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


class CommandQueue:
    """Commands on their way: each acts from its own physics step on, in the order of sending."""

    def __init__(self) -> None:
        self._commands: deque[tuple[int, Command]] = deque()

    def send(self, command: Command, due: int) -> None:
        """Add a command that acts from physics step `due` on; the first one acts at once."""
        self._commands.append((due, command))

    def acting(self, step: int) -> Command:
        """Return the command that acts from a physics step on; steps must not go back."""
        while len(self._commands) > 1 and self._commands[1][0] <= step:
            self._commands.popleft()
        return self._commands[0][1]
