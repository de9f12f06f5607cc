"""Actuators with faults: the command path of the plant with faults before and behind it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ttempc.types import Command

from ..actuation.actuators import ActuatorSpecification, CommandPath, PathState
from .command_faults import BusFault, BusState, ValveFault
from .fault import Window


class FaultyState(NamedTuple):
    """State of a command path with faults."""

    step: int  # physics steps since the start
    inner: PathState  # of the path without faults
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
        faults: Sequence[tuple[BusFault | ValveFault, Window]],
        timestep: float,
        stops: tuple[float, float],
    ) -> None:
        self._path, self._faults, self._timestep = path, tuple(faults), timestep
        self._stops = (*stops, 1.0)

    @property
    def specification(self) -> ActuatorSpecification:
        """Specification of the path without faults."""
        return self._path.specification

    def start(self, hp: float) -> FaultyState:
        """Return the state of a vehicle that drives straight with the hydrostat at `hp`."""
        return FaultyState(0, self._path.start(hp), Command(0.0, 0.0, hp), {}, {}, (0.0, 0.0, hp))

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
            if isinstance(fault, BusFault):
                bus = state.buses.get(k, BusState(state.arrived))
                buses[k] = fault.pass_on(bus, command, now_s)
                command = buses[k].arrived
        inner = self._path.step(state.inner, command, delta_t, delta_i)
        set_points, moved = list(inner.set_points), dict[int, float]()
        for k in active:
            fault = self._faults[k][0]
            if isinstance(fault, ValveFault):
                axis = fault.axis
                moved[k] = set_points[axis] = fault.move(
                    state.moved.get(k, present[axis]),
                    set_points[axis],
                    self._timestep,
                    self._stops[axis],
                )
        front, trailer, hydrostat = set_points
        return FaultyState(
            state.step + 1, inner, command, buses, moved, (front, trailer, hydrostat)
        )
