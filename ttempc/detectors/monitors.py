"""Monitors: the built-in detectors and those of a user, with the alarms that stand."""

import copy
import math
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

import numpy as np

from ..errors import InvalidTuning
from ..layout import ALARM, ESTIMATE, INNOVATION, SAMPLE, AlarmColumn, measurements_of
from ..models.augmented_state import vehicle_parameters
from ..suggestion import did_you_mean
from ..types import Command, Estimate, FloatArray, Input, Sensor
from ..vehicle import Vehicle
from .board import ENDS, NO_ALARM
from .drift import DRIFT, new_drift
from .gyro import GYRO, new_gyro
from .interface import Alarm, Detector, Observation, Reaction
from .kernel import DETECTORS, new_detectors, observe_detectors
from .standstill import STANDSTILL, new_standstill
from .steps import STEPS
from .table import BUILT_IN, COUNT, DetectorIndex
from .velocity import VELOCITY, new_velocity

Detect = bool | Sequence[str | Detector]
"""Choice of detectors, see `chosen`."""

_SENSORS: Final = tuple(Sensor)  # in the order of `SensorIndex`
_NAMES: Final = {row.name: index for index, row in BUILT_IN.items()}


class Chosen(NamedTuple):
    """Detectors that run."""

    built_in: frozenset[DetectorIndex]
    own: tuple[Detector, ...]


def chosen(detect: Detect) -> Chosen:
    """Return the detectors of a choice: all built-in ones, none, or a list.

    A list may have names of built-in detectors, those alone that run; names after a minus sign,
    those that do not run; detectors of a user, which run beside the built-in ones.

    Raises:
        InvalidTuning: there is no built-in detector of a name.

    Examples:
        >>> len(chosen(["-drift"]).built_in), len(chosen(["drift"]).built_in)
        (30, 1)
    """
    if isinstance(detect, bool):
        return Chosen(frozenset(DetectorIndex) if detect else frozenset(), ())
    names = [item for item in detect if isinstance(item, str)]
    own = tuple(item for item in detect if not isinstance(item, str))
    for name in names:
        if name.removeprefix("-") not in _NAMES:
            close = did_you_mean(name.removeprefix("-"), _NAMES)
            raise InvalidTuning(
                f"detect: got {name!r}{close}, allowed are {', '.join(_NAMES)}, each also with '-'"
            )
    only = frozenset(_NAMES[name] for name in names if not name.startswith("-"))
    without = frozenset(_NAMES[name[1:]] for name in names if name.startswith("-"))
    return Chosen((only or frozenset(DetectorIndex)) - without, own)


class MonitorsMemory(NamedTuple):
    """What the monitors remember from tick to tick."""

    record: FloatArray  # `DETECTORS`
    own: tuple[Detector, ...]
    own_alarms: FloatArray  # rows of `ALARM` entries
    said: dict[int, Alarm]  # by the user's detectors, by row


class Monitors:
    """Runs the built-in detectors, then those of a user; keeps alarms until their causes end.

    An alarm begins where a statistic exceeds its limit and ends where it falls below half of it.
    The detectors of a user see no samples that an alarm of a built-in one excludes.

    Args:
        detect: which detectors run, see `chosen`.
        velocity_wander_mps: standard deviation of the slow error that velocities of GNSS share.

    Raises:
        InvalidTuning: there is no built-in detector of a name.
    """

    def __init__(self, detect: Detect = True, velocity_wander_mps: float = 0.002) -> None:
        built_in, self._own = chosen(detect)
        self._count = COUNT if built_in else 0
        # Flat record `DETECTORS`: all that the built-in ones remember
        self.record = new_detectors(velocity_wander_mps)
        self._own_alarms = np.zeros((len(self._own), ALARM))
        self._own_alarms[:, AlarmColumn.REACTION] = NO_ALARM
        self._said: dict[int, Alarm] = {}  # by the user's detectors, by row
        self._vehicle: Vehicle | None = None  # that `_parameters` belong to
        self._parameters = np.empty(0)  # in the order of `VehicleParameter`
        for index in DetectorIndex:
            self._board["enabled"][index] = index in built_in

    def warm_up(self) -> None:
        """Compile or load what `observe` needs; changes no later result."""
        observe_detectors(
            parameters=vehicle_parameters(Vehicle()),
            state=self.record.copy(),
            rows=np.empty((0, SAMPLE)),
            now=0.0,
            command=np.full(3, math.nan),
            estimate=np.zeros(ESTIMATE.itemsize // 8),
            innovations=np.empty((0, INNOVATION)),
        )

    def memory(self) -> MonitorsMemory:
        """Return what the monitors remember; it shares its arrays."""
        return MonitorsMemory(self.record, self._own, self._own_alarms, self._said)

    def restore(self, memory: MonitorsMemory) -> None:
        """Remember what `memory` returned, of these monitors or of a copy of them."""
        given = copy.deepcopy(memory)
        self.record = given.record
        self._own = given.own
        self._own_alarms = given.own_alarms
        self._said = given.said

    def observe(
        self,
        rows: FloatArray,
        now: float,
        sent: FloatArray,
        estimate: FloatArray,
        innovations: FloatArray,
        vehicle: Vehicle,
        view: Callable[[], Estimate],
    ) -> FloatArray:
        """Take in the data of a tick; return rows of `ALARM` entries, one for each detector.

        Args:
            rows: samples (n, `SAMPLE`) that arrived since the tick before, of all sensors.
            now: time of the tick, from the first one [s].
            sent: command of the period before (3,), NaN at the first tick.
            estimate: record `ESTIMATE`.
            innovations: its rows (n, `INNOVATION`).
            vehicle: present model parameters.
            view: makes the estimate, for detectors of a user.
        """
        if self._count:
            if vehicle is not self._vehicle:
                self._take_vehicle(vehicle)
            observe_detectors(self._parameters, self.record, rows, now, sent, estimate, innovations)
        if self._own:
            command = None if math.isnan(sent[0]) else Command(*sent.tolist())
            usable = rows[~np.isin(rows[:, 1], self._excluded())]
            self._observe_own(Observation(now, measurements_of(usable), command, view(), vehicle))
        return self.rows

    def _take_vehicle(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._parameters = vehicle_parameters(vehicle)

    def _observe_own(self, observation: Observation) -> None:
        for index, detector in enumerate(self._own):
            detector.observe(observation)
            row = self._own_alarms[index]
            if detector.statistic > detector.limit and row[AlarmColumn.REACTION] < 0.0:
                self._said[index] = detector.alarm()
                row[AlarmColumn.REACTION] = self._said[index].reaction
            elif detector.statistic < ENDS * detector.limit:
                row[AlarmColumn.REACTION] = NO_ALARM

    @property
    def _board(self) -> np.void:
        return self.record.view(DETECTORS)[0]["board"]

    def _excluded(self) -> list[int]:
        """Return the `SensorIndex` of the sensors that alarms of built-in detectors exclude."""
        return np.flatnonzero(self._board["excluded"]).tolist()

    @property
    def rows(self) -> FloatArray:
        """Alarms that stand, rows of `ALARM` entries by detector."""
        built_in = self._board["alarms"][: self._count]
        return np.concatenate([built_in, self._own_alarms]) if self._own else built_in

    def resume(self) -> None:
        """Take the present estimate for true and every sensor for sound."""
        s = self.record.view(DETECTORS)[0]
        last = s["last"]
        for name in ("time_s", "x", "y", "yaw", "speed", "sd_m"):
            last[name] = math.nan
        s["hitch"]["innovations"] = 0.0
        s["position"]["offset"] = 0.0
        s["drift"] = new_drift().view(DRIFT)[0]
        s["steps"] = np.zeros(1, STEPS)[0]
        s["gyros"] = new_gyro().view(GYRO)[0]
        s["clocks"]["late_s"] = 0.0
        s["standstill"] = new_standstill().view(STANDSTILL)[0]
        wander_mps = float(s["velocity"]["wander_mps"])
        s["velocity"] = new_velocity(wander_mps).view(VELOCITY)[0]
        alarms = s["board"]["alarms"]
        alarms[DetectorIndex.HITCH :] = 0.0
        alarms[DetectorIndex.HITCH :, AlarmColumn.REACTION] = NO_ALARM

    def forget_pose(self) -> None:
        """Begin dead reckoning at the next estimate: that of another estimator is no jump."""
        self.record.view(DETECTORS)[0]["last"]["time_s"] = math.nan

    @property
    def detectors(self) -> tuple[Detector, ...]:
        """All detectors; the built-in ones, by `DetectorIndex`, as they are now.

        One that does not run has a statistic of 0.
        """
        board = self._board
        built_in = [
            Detector(
                BUILT_IN[index].name,
                float(board["limit"][index]),
                float(board["statistic"][index]),
                float(board["residual"][index]),
            )
            for index in DetectorIndex
        ]
        return (*built_in[: self._count], *self._own)

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The alarms that stand, by detector."""
        rows = enumerate(self.rows.tolist())
        return tuple(self._alarm(i, row) for i, row in rows if row[AlarmColumn.REACTION] >= 0.0)

    def reason(self, index: int, alarm: FloatArray) -> str:
        """Return the words of an alarm from the index and the entries (`ALARM`,) of its row."""
        return self._alarm(index, alarm.tolist()).reason

    def usable(self, rows: FloatArray) -> FloatArray:
        """Return the samples without those of sensors that an alarm of the last tick excludes."""
        if not (self.rows[:, AlarmColumn.REACTION] >= 0.0).any():
            return rows
        excluded = self._excluded()
        for index, row in enumerate(self._own_alarms):
            if row[AlarmColumn.REACTION] >= 0.0:
                excluded += [_SENSORS.index(sensor) for sensor in self._said[index].unused]
        return rows[~np.isin(rows[:, 1], excluded)] if excluded else rows

    def obeyed(self, sent: FloatArray) -> FloatArray:
        """Return a command (3,) with NaN for a hydrostat that an alarm says does not obey."""
        if self._board["alarms"][DetectorIndex.HYDROSTAT, AlarmColumn.REACTION] < 0.0:
            return sent
        obeyed = sent.copy()
        obeyed[Input.HP] = math.nan
        return obeyed

    def _alarm(self, index: int, row: Sequence[float]) -> Alarm:
        if index >= self._count:
            return self._said[index - self._count]
        reaction, *numbers = row
        return BUILT_IN[DetectorIndex(index)].alarm(Reaction(int(reaction)), numbers)
