"""Identification of vehicle parameters while the vehicle is driven, in another thread."""

from __future__ import annotations

import atexit
from _thread import start_new_thread
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing import current_process
from threading import Event
from typing import Any, Final, Generic, Protocol, TypeAlias, TypeVar
from weakref import WeakSet

from ..types import Command, FloatArray
from ..vehicle import Vehicle
from .window import RecordedTick, Recorder, Window

LENGTHS: Final = ("wheelbase", "hitch_offset", "drawbar_length", "trailer_length")
"""Fields of `Vehicle` that are lengths [m] of any vehicle."""
TURNING: Final = "trailer_turning_offset"
"""Field of `Vehicle` that is a length [m] of one with a tool; all other learnt ones are times."""

_ATTEMPTS_S: Final = (6.0, 12.0, 20.0, 60.0)  # after the first tick; the first for dead times
_EVERY_S: Final = 60.0  # between attempts after the last of them
_EXCHANGE_S: Final = 5.0  # from an attempt to the exchange: time for the work of the thread
_SOON_S: Final = 2.0  # from an attempt on less than `_SHORT_S` of driving to the exchange
_SHORT_S: Final = 15.0
_MEMORY_S: Final = 120.0  # of driving that is remembered: nearly a lap of the paper's figure eight
_EXIT_S: Final = 1.0  # for which the end of a process waits for its threads


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A vehicle parameter before and after an identification, SI units."""

    name: str  # field of `Vehicle`
    before: float
    after: float
    sd: float  # of the error of `after`

    def __str__(self) -> str:
        unit = "m" if self.name in (*LENGTHS, TURNING) else "s"
        return f"vehicle.{self.name} {self.before:.3g} -> {self.after:.3g} +- {self.sd:.2g} {unit}"


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of one identifier on one window."""

    vehicle: Vehicle  # as given where nothing has changed
    changes: tuple[ParameterChange, ...] = ()  # empty where the data ask for none
    settled: bool = False  # more driving of this kind would change nothing


class Identifier(Protocol):
    """Identifies some of the parameters of a vehicle; it keeps no memory of earlier windows."""

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the parameters that the window asks for.

        A parameter changes only where the data are significant, so that a right model stays as it
        is. Called from another thread than that of the control loop.
        """
        ...


_Parts = TypeVar("_Parts")


class Builder(Protocol[_Parts]):
    """Makes the parts of a guidance for learnt parameters; both methods run in the thread."""

    def build(self, vehicle: Vehicle) -> _Parts:
        """Return new parts for a vehicle."""
        ...

    def replay(self, parts: _Parts, window: Sequence[RecordedTick]) -> None:
        """Let new parts receive recorded ticks."""
        ...


@dataclass(frozen=True, slots=True)
class Learnt(Generic[_Parts]):
    """Changed parameters, and what was built for them; it has received every recorded tick."""

    changes: tuple[ParameterChange, ...]
    vehicle: Vehicle
    parts: _Parts
    sent: tuple[Command, ...]  # recorded since the attempt began, oldest first


_Outcome: TypeAlias = tuple[Identification, Any, list[Identifier]]
"""What an attempt has found, its parts, None where nothing changes, and open identifiers."""


@dataclass(slots=True, eq=False, weakref_slot=True)
class _WorkerTask:
    """Work of a thread, to be begun anew where there is none: in a copy, in a child of a fork."""

    process: int | None = None  # number of the thread's process
    done: Event = field(default_factory=Event)
    outcome: _Outcome | None = None
    error: BaseException | None = None


class Learner(Generic[_Parts]):
    """Records ticks, identifies parameters and has new parts built for them.

    An attempt begins 6, 12, 20 and 60 s after the first tick and every minute after that, on the
    last two minutes of driving. Identification and building run in a thread of their own. Their
    result is due at a tick 5 s after the beginning, of the first two attempts 2 s. Who calls `wait`
    at every tick gets it at that tick, whenever the thread was done, so that a run does not depend
    on computing time; who does not gets it at the first tick from there on at which the thread is
    done. Nothing else waits: new parts receive what was recorded meanwhile in the thread too, in
    tasks, until a task ends before the next tick. An identifier that has settled is left out of
    later attempts.

    A learner can be copied and pickled as the identifiers and the builder can. A copy, and the
    child of a process that forks, begins an attempt under way anew, from the same window.
    """

    def __init__(
        self,
        identifiers: Sequence[Identifier],
        vehicle: Vehicle,
        period_s: float,
        builder: Builder[_Parts],
    ) -> None:
        self._identifiers = list(identifiers)
        self._vehicle = vehicle
        self._builder = builder
        self._period_s = period_s
        self._memory = round(_MEMORY_S / period_s) + 1
        self._every = round(_EVERY_S / period_s)
        self._attempts = [round(time_s / period_s) for time_s in _ATTEMPTS_S]
        self._recorder = Recorder(self._memory)
        self._window: Window | None = None  # of the attempt under way
        self._begun = 0  # tick at which it began
        self._due = 0  # tick of its exchange
        self._recorded = 0  # ticks that were recorded at its beginning
        self._received = 0  # ticks that its parts have received
        self._reported = False  # whether `overdue` has said that it takes long
        self._task = _WorkerTask()

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_task": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _task=_WorkerTask())

    def record(
        self,
        k: int,
        time_s: float,
        samples: FloatArray,
        command: FloatArray,
        psi_t: float,
        psi_i: float,
    ) -> None:
        """Record what the estimator received at tick `k`, and begin an attempt where one is due.

        `samples` are rows (n, 5) of `SAMPLE` in the order of arrival, `command` is that of the
        period before (3,), NaN where there was none; then the estimated headings [rad].
        """
        if not self._identifiers:
            return
        self._recorder.append(time_s, samples, command, psi_t, psi_i)
        if self._window is not None:
            if self._work().done.is_set() and k >= self._due - 1:
                self._catch_up()
        elif k >= self._attempts[0]:
            self._attempts = self._attempts[1:] or [k + self._every]
            delay_s = _SOON_S if k * self._period_s < _SHORT_S else _EXCHANGE_S
            self._begun = k
            self._due = k + round(delay_s / self._period_s)
            self._reported = False
            self._recorded = self._recorder.count
            self._window = self._recorder.since(self._recorded - self._memory)
            self._begin()

    def wait(self, k: int) -> None:
        """Wait for the thread, without a limit, if tick `k` is the one of its exchange or later."""
        if self._window is None or k < self._due:
            return
        if not self._work().done.is_set():
            self._task.done.wait()
        self._catch_up()
        if not self._task.done.is_set():
            self._task.done.wait()

    def forget(self) -> None:
        """Drop what was recorded, and an attempt under way: it was of a vehicle with a fault."""
        self._recorder = Recorder(self._memory)
        self._window = None

    def overdue(self, k: int) -> bool:
        """Whether an attempt has taken until the next one would begin; once for each attempt."""
        late = self._window is not None and not self._reported and k >= self._begun + self._every
        self._reported |= late
        return late

    def exchange(self, k: int) -> Learnt[_Parts] | None:
        """Return what the last attempt has learnt if it is due at tick `k` and done.

        Raises:
            Exception: what the identifiers or the builder raised; nothing more is learnt then.
        """
        if self._window is None or k < self._due or not self._work().done.is_set():
            return None
        task = self._task
        if task.outcome is None:
            self._window = None
            self._identifiers = []
            error = task.error
            raise error if isinstance(error, Exception) else RuntimeError(repr(error))
        result, parts, open_ones = task.outcome
        if parts is not None and self._received < self._recorder.count:
            return None
        self._window = None
        self._identifiers = open_ones
        self._vehicle = result.vehicle
        if parts is None:
            return None
        since = self._recorder.since(self._recorded)
        sent = tuple(tick.command for tick in since if tick.command is not None)
        return Learnt(result.changes, result.vehicle, parts, sent)

    def _work(self) -> _WorkerTask:
        """Return the present task, begun anew where its thread is of another process."""
        if self._task.process != current_process().pid and not self._task.done.is_set():
            self._begin()
        return self._task

    def _begin(self) -> None:
        assert self._window is not None
        self._received = self._recorded
        self._start(self._window, None)

    def _catch_up(self) -> None:
        """Begin a task in which new parts receive what they have not yet received, if any."""
        outcome = self._task.outcome
        received = self._received
        if outcome is None or outcome[1] is None or received == self._recorder.count:
            return
        self._received = self._recorder.count
        self._start(self._recorder.since(received), outcome)

    def _start(self, window: Window, outcome: _Outcome | None) -> None:
        task = self._task = _WorkerTask(current_process().pid)
        work = window, [*self._identifiers], self._vehicle, self._builder, outcome

        def run() -> None:
            try:
                task.outcome = _attempt(*work)
            except BaseException as error:  # a user's code may also exit
                task.error = error
            finally:
                task.done.set()

        _TASKS.add(task)
        try:
            start_new_thread(run, ())  # `Thread.start` waits until the thread runs
        except RuntimeError as error:  # the system has no more of them
            task.error = error
            task.done.set()


def _attempt(
    window: Window,
    identifiers: Sequence[Identifier],
    vehicle: Vehicle,
    builder: Builder[Any],
    outcome: _Outcome | None,
) -> _Outcome:
    if outcome is None:
        changes: list[ParameterChange] = []
        open_ones: list[Identifier] = []
        for identifier in identifiers:
            result = identifier.identify(window, vehicle)
            vehicle = result.vehicle
            changes += result.changes
            if not result.settled:
                open_ones.append(identifier)
        parts = builder.build(vehicle) if changes else None
        outcome = Identification(vehicle, tuple(changes)), parts, open_ones
    if outcome[1] is not None:
        builder.replay(outcome[1], window)
    return outcome


_TASKS: Final = WeakSet[_WorkerTask]()


def _leave() -> None:
    # A thread ends with the process, also that of an identifier that never returns; one that is at
    # the end of its work shall not meet an interpreter that is being taken down.
    for task in [*_TASKS]:
        ours = task.process == current_process().pid and not task.done.is_set()
        if ours and not task.done.wait(_EXIT_S):
            break


atexit.register(_leave)
