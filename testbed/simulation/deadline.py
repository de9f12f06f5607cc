"""Deadline of a control step that never returns."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from time import monotonic, thread_time
from types import FrameType
from typing import Final

STEP_LIMIT_S: Final = 60.0
"""Processor time after which a call of the guidance is ended; assumed: 300 control periods."""

PATIENCE: Final = 10.0
"""Wall-clock time over the limit of the processor time, for a part that sleeps; assumed."""

_LONGEST_S: Final = 1.0  # between two looks at the time
_LOOKS: Final = 4.0  # at least within a limit


class Deadline:
    """Limit of the processor time of a user's part, a context manager about each of its calls.

    Other processes do not use it up. While `watch` holds, an alarm of the operating system looks at
    the time again and again. Python runs its handler between two of its instructions in the main
    thread. In another thread there is no limit, and compiled code that does not return cannot be
    ended so. Parts are not nested.
    """

    def __init__(self, limit_s: float = STEP_LIMIT_S) -> None:
        self._limit_s = limit_s
        self._begun: tuple[float, float] | None = None  # processor and wall-clock time [s]

    def __enter__(self) -> None:
        self._begun = thread_time(), monotonic()

    def __exit__(self, *error: object) -> None:
        self._begun = None

    @contextmanager
    def watch(self) -> Iterator[None]:
        """Raise `TimeoutError` in a part that takes longer than the limit."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        period_s = min(_LONGEST_S, self._limit_s / _LOOKS)
        handler = signal.signal(signal.SIGALRM, self._look)
        timer = signal.setitimer(signal.ITIMER_REAL, period_s, period_s)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            signal.signal(signal.SIGALRM, handler)
            signal.setitimer(signal.ITIMER_REAL, *timer)

    def _look(self, number: int, frame: FrameType | None) -> None:
        if self._begun is None:
            return
        spent_s = thread_time() - self._begun[0]
        passed_s = monotonic() - self._begun[1]
        if spent_s > self._limit_s:
            raise TimeoutError(f"did not return within {self._limit_s:g} s of processor time")
        if passed_s > PATIENCE * self._limit_s:
            raise TimeoutError(f"did not return within {PATIENCE * self._limit_s:g} s")
