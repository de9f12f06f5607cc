"""Identification of vehicle parameters while the vehicle is driven, in another thread."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import Final, Generic, Protocol, TypeVar

from ..types import Command, Measurement, WarmingUp
from ..vehicle import Vehicle

LENGTHS: Final = ("wheelbase", "hitch_offset", "drawbar_length", "trailer_length")
"""Fields of `Vehicle` that are lengths [m]; all others that are identified are times [s]."""

_ATTEMPTS_S: Final = (6.0, 12.0, 20.0, 60.0)  # after the first tick; the first for dead times
_EVERY_S: Final = 60.0  # after the last of them
_EXCHANGE_S: Final = 5.0  # from an attempt to the exchange: time for the work of the thread
_SOON_S: Final = 2.0  # the same of the attempts on less than `_SHORT_S` of driving
_SHORT_S: Final = 15.0
_MEMORY_S: Final = 120.0  # of driving that is kept: nearly a lap of the paper's figure eight


@dataclass(frozen=True, slots=True)
class RecordedTick:
    """What an estimator received at one control tick."""

    time_s: float
    samples: tuple[Measurement, ...]  # in the order of arrival
    command: Command | None  # of the period before; None at the first tick
    headings: tuple[float, float]  # estimated yaw of tractor and trailer [rad], may be NaN


@dataclass(frozen=True, slots=True)
class ParameterChange:
    """A vehicle parameter before and after an identification, SI units."""

    name: str  # field of `Vehicle`
    before: float
    after: float
    sd: float  # of the error of `after`

    def __str__(self) -> str:
        unit = "m" if self.name in LENGTHS else "s"
        return f"vehicle.{self.name} {self.before:.3g} -> {self.after:.3g} +- {self.sd:.2g} {unit}"


@dataclass(frozen=True, slots=True)
class Identification:
    """Result of one identifier on one window."""

    vehicle: Vehicle  # the one given where nothing has changed
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


@dataclass(frozen=True, slots=True)
class Learnt(Generic[_Parts]):
    """Changed parameters, and what was built for them."""

    changes: tuple[ParameterChange, ...]
    vehicle: Vehicle
    parts: _Parts
    since: tuple[RecordedTick, ...]  # recorded after the window of the attempt


class Learner(Generic[_Parts]):
    """Records ticks, identifies parameters and has new parts built for them.

    An attempt begins 6, 12, 20 and 60 s after the first tick and every minute after that, on the
    last two minutes of driving. Identification and building run in a thread of their own. Their
    result is taken at a tick 5 s after the beginning, of the first two attempts 2 s, whenever the
    thread was done, so that a run does not depend on computing time; if it is not done by then, the
    tick waits for it. An identifier that has settled is left out of later attempts.
    """

    def __init__(
        self,
        identifiers: Sequence[Identifier],
        vehicle: Vehicle,
        period_s: float,
        build: Callable[[Vehicle, Sequence[RecordedTick]], _Parts],
    ) -> None:
        self._identifiers = list(identifiers)
        self._vehicle = vehicle
        self._build = build
        self._memory = round(_MEMORY_S / period_s)
        self._every, self._period_s = round(_EVERY_S / period_s), period_s
        self._attempts = [round(time_s / period_s) for time_s in _ATTEMPTS_S]
        self._window: list[RecordedTick] = []
        self._since: list[RecordedTick] = []
        self._due = 0  # tick of the exchange
        self._work: Future[tuple[Identification, _Parts | None, list[Identifier]]] | None = None

    def warm_up(self) -> None:
        for identifier in self._identifiers:
            if isinstance(identifier, WarmingUp):
                identifier.warm_up()

    def record(self, k: int, tick: RecordedTick) -> None:
        """Record what the estimator received at tick `k`, and begin an attempt where one is due."""
        if not self._identifiers:
            return
        self._window = [*self._window[-self._memory :], tick]
        self._since.append(tick)
        if self._work is None and k >= self._attempts[0]:
            self._attempts = self._attempts[1:] or [k + self._every]
            delay_s = _SOON_S if k * self._period_s < _SHORT_S else _EXCHANGE_S
            self._since, self._due = [], k + round(delay_s / self._period_s)
            executor = ThreadPoolExecutor(1, "ttempc-learning")
            self._work = executor.submit(self._attempt, self._window)
            executor.shutdown(wait=False)

    def wait(self, k: int) -> None:
        """Wait for the thread if tick `k` is the one of its exchange."""
        if self._work is not None and k >= self._due:
            wait([self._work])

    def forget(self) -> None:
        """Drop what was recorded, and an attempt under way: it was of a vehicle with a fault."""
        self._window, self._since, self._work = [], [], None

    def exchange(self, k: int) -> Learnt[_Parts] | None:
        """Return what the last attempt has learnt if tick `k` is the one of its exchange.

        Raises:
            Exception: what the identifiers or `build` raised; nothing more is learnt then.
        """
        if self._work is None or k < self._due:
            return None
        work, self._work = self._work, None
        try:
            result, parts, self._identifiers = work.result()
        except Exception:
            self._identifiers = []
            raise
        if parts is None:
            return None
        self._vehicle = result.vehicle
        return Learnt(result.changes, result.vehicle, parts, tuple(self._since))

    def _attempt(
        self, window: Sequence[RecordedTick]
    ) -> tuple[Identification, _Parts | None, list[Identifier]]:
        vehicle, changes, open_ones = self._vehicle, list[ParameterChange](), list[Identifier]()
        for identifier in self._identifiers:
            result = identifier.identify(window, vehicle)
            vehicle = result.vehicle
            changes += result.changes
            if not result.settled:
                open_ones.append(identifier)
        parts = self._build(vehicle, window) if changes else None
        return Identification(vehicle, tuple(changes)), parts, open_ones
