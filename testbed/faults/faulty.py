"""Sensors and actuators with faults."""

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np

from ttempc.layout import SAMPLE
from ttempc.types import Command, FloatArray

from ..actuation.actuators import CommandPath
from ..randomness import generator
from ..sensing.sensor_specification import SensorSpecification
from ..sensing.sensors import NUMBER
from .fault import Fault, Window
from .kinds import BusState, SampleFilter, Sampling, sensors_of, valve

_TAKEN: Final = SAMPLE + 1  # column of the sampling time in the rows of a `Change`


class SampleFaults:
    """Changes samples by faults in their order, see `SensorSuite.changes`.

    A fault changes the samples that are taken while it lasts, whenever they arrive.

    Args:
        faults: with their numbers in the scenario and their windows.
        specification: of the sensors.
        timestep: physics step [s].
        seed: of the run.
    """

    def __init__(
        self,
        faults: Sequence[tuple[int, Fault, Window]],
        specification: SensorSpecification,
        timestep: float,
        seed: int,
    ) -> None:
        self._chain: list[tuple[Window, dict[int, SampleFilter]]] = []
        for number, fault, window in faults:
            filters = {}
            for sensor in sensors_of(fault):
                rng = generator(seed, f"fault {number} {fault.kind} {sensor}")
                run = Sampling(window, specification, sensor, timestep, rng)
                filters[NUMBER[sensor]] = fault.row.effect(fault, run)
            self._chain.append((window, filters))

    def __call__(self, samples: FloatArray) -> FloatArray:
        """Return what arrives in the place of samples."""
        for window, filters in self._chain:
            acts = window.hold(samples[:, _TAKEN])
            if not acts.any():
                continue
            sensors = np.where(acts, samples[:, 1], -1.0)
            places = np.arange(len(samples))
            parts = []
            order = []
            for number in np.unique(sensors):
                mine = sensors == number
                change = filters.get(int(number))
                arrived = change(samples[mine]) if change else samples[mine]
                each = len(arrived) // np.count_nonzero(mine)  # samples in the place of one
                parts.append(arrived)
                order.append(np.repeat(places[mine], each))
            samples = np.concatenate(parts)[np.argsort(np.concatenate(order), kind="stable")]
        return samples


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

    def __init__(
        self,
        path: CommandPath,
        faults: Sequence[tuple[Fault, Window]],
        timestep: float,
        stops: tuple[float, float],
    ) -> None:
        self._path = path
        self._faults = tuple(faults)
        self._timestep = timestep
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
        set_points = list(self._path.set_points(inner))
        moved = dict[int, float]()
        for k in active:
            fault = self._faults[k][0]
            if fault.row.on == "valve":
                axis = valve(fault)
                memory = state.moved.get(k, present[axis])
                stop = self._stops[axis]
                target = set_points[axis]
                moved[k] = fault.row.effect(fault, memory, target, self._timestep, stop)
                set_points[axis] = moved[k]
        front, trailer, hp = set_points
        return FaultyState(state.step + 1, inner, command, buses, moved, (front, trailer, hp))
