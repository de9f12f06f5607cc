"""Identification of vehicle parameters while the vehicle is driven, in another thread."""

from __future__ import annotations

import atexit
from _thread import start_new_thread
from collections.abc import Sequence
from dataclasses import dataclass, field
from multiprocessing import current_process
from threading import Event
from typing import Any, Final, Generic, NamedTuple, Protocol, TypeVar
from weakref import WeakSet

from ..types import Command, FloatArray
from ..vehicle import Vehicle
from .window import RecordedTick, Recorder, Window

LENGTHS: Final = ("wheelbase", "hitch_offset", "drawbar_length", "trailer_length")
"""Fields of `Vehicle` that are lengths [m] of any vehicle."""
TURNING: Final = "trailer_turning_offset"
"""Field of `Vehicle` that is a length [m] of a vehicle with a tool; other learnt ones are times."""

# Begin of the first attempts after the first tick. The first one is early for the dead times.
_ATTEMPTS_S: Final = (6.0, 12.0, 20.0, 60.0)
_EVERY_S: Final = 60.0  # from one later attempt to the next
# Time from the beginning of an attempt to its exchange, in which the thread works. It is shorter
# for an attempt that begins early: there is less driving to identify.
_EXCHANGE_S: Final = 5.0
_EARLY_EXCHANGE_S: Final = 2.0
_EARLY_S: Final = 15.0  # time after the first tick up to which an attempt is early
_MEMORY_S: Final = 120.0  # remembered driving: nearly a lap of the paper's figure eight
_EXIT_S: Final = 1.0  # time for which the end of a process waits for its threads


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A vehicle parameter before and after an identification, SI units."""

    name: str  # field of `Vehicle`
    before: float
    after: float
    sd: float  # standard deviation of the error of `after`

    def __str__(self) -> str:
        unit = "m" if self.name in (*LENGTHS, TURNING) else "s"
        return f"vehicle.{self.name} {self.before:.3g} -> {self.after:.3g} +- {self.sd:.2g} {unit}"


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of one identifier on one window."""

    vehicle: Vehicle  # the given one where nothing has changed
    changes: tuple[ParameterChange, ...] = ()  # empty where the data require none
    settled: bool = False  # more driving of this kind would change nothing


class Identifier(Protocol):
    """Identifies some of the parameters of a vehicle; it keeps no memory of earlier windows."""

    def identify(self, window: Sequence[RecordedTick], vehicle: Vehicle) -> Identification:
        """Return `vehicle` with the parameters that explain the window.

        A parameter changes only where the data are significant, so that a correct model does not
        change. This method is not called from the thread of the control loop.
        """
        ...


_Parts = TypeVar("_Parts")


class Builder(Protocol[_Parts]):
    """Makes the parts of a guidance for learnt parameters, in the thread of the learner."""

    def build(self, vehicle: Vehicle) -> _Parts:
        """Return new parts for a vehicle."""
        ...

    def replay(self, parts: _Parts, window: Sequence[RecordedTick]) -> None:
        """Pass recorded ticks to new parts."""
        ...


@dataclass(frozen=True, slots=True)
class Learnt(Generic[_Parts]):
    """Changed parameters, and parts built for them that have received every recorded tick."""

    changes: tuple[ParameterChange, ...]
    vehicle: Vehicle
    parts: _Parts
    sent: tuple[Command, ...]  # commands since the attempt began, oldest first


class _Outcome(NamedTuple):
    """Result of the thread's work in an attempt."""

    changes: tuple[ParameterChange, ...]
    vehicle: Vehicle
    parts: Any  # None where nothing changes
    open_identifiers: list[Identifier]  # those that have not settled


@dataclass(slots=True, eq=False, weakref_slot=True)
class _WorkerTask:
    """Work of one thread.

    A copy of a learner and the child of a fork have no such thread: they begin the work anew.
    """

    process: int | None = None  # process identifier of the thread's process
    done: Event = field(default_factory=Event)
    outcome: _Outcome | None = None
    error: BaseException | None = None


class Learner(Generic[_Parts]):
    """Records ticks, identifies parameters and has new parts built for them.

    An attempt begins 6, 12, 20 and 60 s after the first tick and every minute after that. It uses
    the last two minutes of driving. Identification and building run in a thread of their own. Their
    result is due at the exchange, 5 s after the beginning of the attempt, or 2 s after the
    beginning of one of the first two. An identifier that has settled is left out of later attempts.

    A caller that calls `wait` at every tick gets the result at the tick of the exchange, so that a
    run does not depend on computing time. Another caller gets it at the first tick from the
    exchange on at which the thread is done. Nothing else waits. New parts receive the ticks that
    were recorded meanwhile in the thread too: one task follows another until a task ends before
    the next tick.

    A learner can be copied and pickled where the identifiers and the builder can. A copy, and the
    child of a process that forks, begins an unfinished attempt anew, from the same window.
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

        # The present attempt.
        self._window: Window | None = None  # None: there is no attempt
        self._begun = 0  # tick at which it began
        self._due = 0  # tick of its exchange
        self._recorded = 0  # number of ticks that were recorded at its beginning
        self._received = 0  # number of ticks that its parts have received
        self._reported = False  # whether `overdue` has reported it
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

        `samples` are rows (n, 5) of `SAMPLE` in the order of arrival. `command` (3,) is the command
        of the period before, NaN where there was none. `psi_t` and `psi_i` are the estimated
        headings [rad].
        """
        if not self._identifiers:
            return
        self._recorder.append(time_s, samples, command, psi_t, psi_i)
        if self._window is not None:
            if self._work().done.is_set() and k >= self._due - 1:
                self._catch_up()
        elif k >= self._attempts[0]:
            self._begin_attempt(k)

    def wait(self, k: int) -> None:
        """Wait for the thread, without a limit, if the exchange is at tick `k` or before."""
        if self._window is None or k < self._due:
            return
        if not self._work().done.is_set():
            self._task.done.wait()
        self._catch_up()
        if not self._task.done.is_set():
            self._task.done.wait()

    def forget(self) -> None:
        """Discard the recorded ticks and the present attempt, because the vehicle had a fault."""
        self._recorder = Recorder(self._memory)
        self._window = None

    def overdue(self, k: int) -> bool:
        """Return whether the next attempt would begin by now, once for each attempt."""
        if self._window is None or self._reported:
            return False
        self._reported = k >= self._begun + self._every
        return self._reported

    def exchange(self, k: int) -> Learnt[_Parts] | None:
        """Return the result of the last attempt if it is due at tick `k` and done.

        Raises:
            Exception: the exception of the identifiers or the builder. Nothing is learnt after it.
        """
        if self._window is None or k < self._due or not self._work().done.is_set():
            return None
        outcome = self._task.outcome
        if outcome is None:
            self._window = None
            self._identifiers = []
            error = self._task.error
            raise error if isinstance(error, Exception) else RuntimeError(repr(error))
        if outcome.parts is not None and self._received < self._recorder.count:
            return None  # the next task passes the ticks that are missing

        self._window = None
        self._identifiers = outcome.open_identifiers
        self._vehicle = outcome.vehicle
        if outcome.parts is None:
            return None
        since = self._recorder.since(self._recorded)
        sent = tuple(tick.command for tick in since if tick.command is not None)
        return Learnt(outcome.changes, outcome.vehicle, outcome.parts, sent)

    def _work(self) -> _WorkerTask:
        """Return the present task; it is begun anew where its thread is in another process."""
        if self._task.process != current_process().pid and not self._task.done.is_set():
            self._begin_task()
        return self._task

    def _begin_attempt(self, k: int) -> None:
        """Begin an attempt at tick `k`, on the remembered ticks."""
        early = k * self._period_s < _EARLY_S
        delay_s = _EARLY_EXCHANGE_S if early else _EXCHANGE_S
        self._attempts = self._attempts[1:] or [k + self._every]
        self._begun = k
        self._due = k + round(delay_s / self._period_s)
        self._reported = False
        self._recorded = self._recorder.count
        self._window = self._recorder.since(self._recorded - self._memory)
        self._begin_task()

    def _begin_task(self) -> None:
        """Begin the first task of the present attempt."""
        assert self._window is not None
        self._received = self._recorded
        self._start(self._window, None)

    def _catch_up(self) -> None:
        """Begin a task that passes new parts the ticks that they have not yet received, if any."""
        outcome = self._task.outcome
        received = self._received
        if outcome is None or outcome.parts is None or received == self._recorder.count:
            return
        self._received = self._recorder.count
        self._start(self._recorder.since(received), outcome)

    def _start(self, window: Window, outcome: _Outcome | None) -> None:
        """Start a thread that identifies and builds, or passes a window to the parts of `outcome`.

        The thread has no access to the learner itself, which changes meanwhile.
        """
        task = _WorkerTask(current_process().pid)
        self._task = task
        identifiers = list(self._identifiers)
        vehicle = self._vehicle
        builder = self._builder

        def run() -> None:
            try:
                if outcome is None:
                    task.outcome = _attempt(window, identifiers, vehicle, builder)
                else:
                    builder.replay(outcome.parts, window)
                    task.outcome = outcome
            except BaseException as error:  # a user's code may also exit
                task.error = error
            finally:
                task.done.set()

        _TASKS.add(task)
        try:
            # `Thread.start` would wait until the thread runs.
            start_new_thread(run, ())
        except RuntimeError as error:  # the system has no more threads
            task.error = error
            task.done.set()


def _attempt(
    window: Window, identifiers: Sequence[Identifier], vehicle: Vehicle, builder: Builder[Any]
) -> _Outcome:
    """Return the changes that the identifiers find one after another, and new parts for them."""
    changes: list[ParameterChange] = []
    open_identifiers: list[Identifier] = []
    for identifier in identifiers:
        result = identifier.identify(window, vehicle)
        vehicle = result.vehicle
        changes += result.changes
        if not result.settled:
            open_identifiers.append(identifier)

    parts = builder.build(vehicle) if changes else None
    if parts is not None:
        builder.replay(parts, window)
    return _Outcome(tuple(changes), vehicle, parts, open_identifiers)


_TASKS: Final = WeakSet[_WorkerTask]()


def _wait_for_tasks() -> None:
    """Wait at the end of the process for unfinished tasks, `_EXIT_S` at most for each.

    A thread ends with the process, also the thread of an identifier that never returns. A thread
    that is about to finish shall not run while the interpreter shuts down. The first task that
    does not finish in time ends the wait.
    """
    for task in list(_TASKS):
        ours = task.process == current_process().pid and not task.done.is_set()
        if ours and not task.done.wait(_EXIT_S):
            break


atexit.register(_wait_for_tasks)
