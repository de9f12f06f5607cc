"""Sensors and actuators with faults."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ttempc.types import Command, Measurement, Sensor

from ..actuation.actuators import CommandPath
from ..randomness import generator
from ..sensing.sensors import SensorSuite
from ..truth import Truth
from .fault import Fault, Window
from .kinds import BusState, SampleFilter, Sampling, sensors_of, valve


class FaultySensors:
    """Passes on the samples of other sensors, changed by the faults in their order.

    A fault changes the samples that are taken while it lasts, whenever they arrive.

    Args:
        sensors: without faults.
        faults: with their numbers in the scenario and their windows.
        timestep: physics step [s].
        seed: of the run.
    """

    def __init__(
        self,
        sensors: SensorSuite,
        faults: Sequence[tuple[int, Fault, Window]],
        timestep: float,
        seed: int,
    ) -> None:
        self._sensors, self._timestep = sensors, timestep
        self._in_transit: list[tuple[int, Measurement]] = []  # physics step of delivery, sample
        self._chain: list[tuple[Window, dict[Sensor, SampleFilter]]] = []
        for number, fault, window in faults:
            filters = {
                sensor: fault.row.effect(fault, Sampling(window, sensors.specification, rng))
                for sensor in sensors_of(fault)
                for rng in (generator(seed, f"fault {number} {fault.kind} {sensor}"),)
            }
            self._chain.append((window, filters))

    @property
    def every(self) -> int:
        """Physics steps between two moments at which any sensor samples or delivers."""
        return self._sensors.every

    def sample(self, truth: Truth, step: int) -> list[Measurement]:
        """Return the samples that arrive at physics step `step`."""
        for sample in self._sensors.sample(truth, step):
            for delay_s, changed in self._changed(sample):
                self._in_transit.append((step + round(delay_s / self._timestep), changed))
        arrived = [sample for due, sample in self._in_transit if due <= step]
        self._in_transit = [item for item in self._in_transit if item[0] > step]
        return arrived

    def _changed(self, sample: Measurement) -> list[tuple[float, Measurement]]:
        """Return what arrives in the place of a sample, each with its further delay [s]."""
        items = [(0.0, sample)]
        for window, filters in self._chain:
            if not window.holds(sample.time_s):
                continue
            after = []
            for delay_s, item in items:
                change = filters.get(item.sensor)
                changed = change(item) if change else [(0.0, item)]
                after += [(delay_s + further_s, one) for further_s, one in changed]
            items = after
        return items


Sensors = SensorSuite | FaultySensors


class FaultyState(NamedTuple):
    """State of a command path with faults."""

    step: int  # physics steps since the start
    inner: Any  # of the path without faults
    arrived: Command  # command at the valves in the step before
    buses: Mapping[int, BusState]  # of the active faults, by their places in the list
    moved: Mapping[int, float]  # set points of the active faults of valves, in the same way
    set_points: tuple[float, float, float]  # front and trailer angle [rad], hydrostat


class FaultyActuators:
    """A command path; each step passes through the faults that act at that time.

    Args:
        path: without faults.
        faults: in the order of the scenario, with their windows.
        timestep: physics step [s].
        stops: front and trailer steering angle at the stops [rad].
    """

    passive = False

    def __init__(
        self,
        path: CommandPath,
        faults: Sequence[tuple[Fault, Window]],
        timestep: float,
        stops: tuple[float, float],
    ) -> None:
        self._path, self._faults, self._timestep = path, tuple(faults), timestep
        self._stops = (*stops, 1.0)

    def start(self, hp: float) -> FaultyState:
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""
        return FaultyState(0, self._path.start(hp), Command(0.0, 0.0, hp), {}, {}, (0.0, 0.0, hp))

    def set_points(self, state: FaultyState) -> tuple[float, float, float]:
        """Return the servos' front and trailer angle [rad] and the hydrostat's position."""
        return state.set_points

    def step(
        self, state: FaultyState, command: Command, delta_t: float, delta_i: float
    ) -> FaultyState:
        """Return the state after one physics step; the arguments are the present angles [rad]."""
        now_s = state.step * self._timestep
        present = (delta_t, delta_i, state.set_points[2])
        active = [k for k, (_, window) in enumerate(self._faults) if window.holds(now_s)]
        buses: dict[int, BusState] = {}
        for k in active:
            fault = self._faults[k][0]
            if fault.row.on == "bus":
                bus = state.buses.get(k, BusState(state.arrived))
                buses[k] = fault.row.effect(fault, bus, command, now_s)
                command = buses[k].arrived
        inner = self._path.step(state.inner, command, delta_t, delta_i)
        set_points, moved = list(self._path.set_points(inner)), dict[int, float]()
        for k in active:
            fault = self._faults[k][0]
            if fault.row.on == "valve":
                axis = valve(fault)
                moved[k] = set_points[axis] = fault.row.effect(
                    fault,
                    state.moved.get(k, present[axis]),
                    set_points[axis],
                    self._timestep,
                    self._stops[axis],
                )
        front, trailer, hydrostat = set_points
        return FaultyState(
            state.step + 1, inner, command, buses, moved, (front, trailer, hydrostat)
        )
