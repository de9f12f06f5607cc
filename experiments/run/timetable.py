"""Timetable of a run: the faults of a scenario, each at its time and place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from ttempc.reference.reference import Reference

from ...testbed.errors import InvalidFault
from ...testbed.faults.fault import Fault, FaultContext, LastingFault, Window
from ...testbed.faults.faulty import FaultyActuators, SampleFaults
from ...testbed.faults.kinds import Effect, refusal
from ...testbed.ground.soil import Patch, SoilMap
from ...testbed.ground.terrain import Terrain
from ...testbed.recording.record import BEGINS, ENDS, FAULT, Event
from ...testbed.sensing.sensors import SensorSuite
from ...testbed.simulation.plant import Plant
from ...testbed.simulation.setup import SimulationSetup, Stage, TickContext
from ...testbed.vehicle.vehicle import PlantVehicle
from ..scenario.controller import TRUTH
from ..scenario.scenario import Scenario

_SAME_TIME: Final = 1e-9  # times closer than this share of a control period are one


@dataclass(frozen=True)
class Timetable:
    """Faults of a run with their windows; one that cannot act raises `InvalidFault`."""

    faults: tuple[Fault, ...]
    reference: Reference
    ticks: int
    context: FaultContext

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        vehicle: PlantVehicle,
        reference: Reference,
        ticks: int,
        seed: int,
    ) -> Timetable:
        """Return the timetable of a run; `ticks` are its control periods.

        Faults of other seeds are refused as those of this one, so that no later run fails by them.
        """
        context = FaultContext(
            period_s=scenario.control.period_s,
            sensors=scenario.sensors,
            vehicle=vehicle,
            true_state=scenario.controller.estimator == TRUTH,
        )
        table = cls(scenario.faults, reference, ticks, context)
        return replace(table, faults=tuple(f for f in scenario.faults if f.in_run(seed)))

    def __post_init__(self) -> None:
        labels = [fault.label for fault in self.faults]
        for number, (fault, window) in enumerate(zip(self.faults, self.windows, strict=True)):
            reason = self._refusal(fault, window) or refusal(fault, window, self.context)
            if not reason and labels.count(fault.label) > 1:
                reason = "another fault has this name; give each a name of its own"
            if reason:
                raise InvalidFault(f"faults.{number} ({fault.label}): {reason}")

    def _refusal(self, fault: Fault, window: Window) -> str:
        end_s = self.ticks * self.context.period_s
        length_m = self._distances[-1]
        if fault.at_m is not None and fault.at_m >= length_m:
            return f"got at_m {fault.at_m:g}, must be below the end of the path, {length_m:.1f}"
        if window.start_s >= end_s:
            return f"got start_s {window.start_s:g}, must be below the end of the run, {end_s:.1f}"
        return ""

    @cached_property
    def windows(self) -> tuple[Window, ...]:
        """When each fault acts."""
        return tuple(self._window(fault) for fault in self.faults)

    def _window(self, fault: Fault) -> Window:
        start_s = fault.start_s
        if start_s is None:
            start_s = float(np.interp(fault.at_m or 0.0, self._distances, self._times_s))
        lasts_s = fault.duration_s if isinstance(fault, LastingFault) else None
        return Window(start_s, math.inf if lasts_s is None else start_s + lasts_s)

    @cached_property
    def _times_s(self) -> np.ndarray:
        return np.arange(self.ticks + 1) * self.context.period_s

    @cached_property
    def _distances(self) -> np.ndarray:
        """Distance along the path [m] at each tick."""
        distances = self.reference.speed.travel(self._times_s)[0]
        return np.minimum(np.abs(distances - distances[0]), self.reference.path.length_m)

    def _on(self, *targets: str) -> list[tuple[int, Fault, Window]]:
        """Return the faults that act on targets of `Row.on`, with their numbers and windows."""
        pairs = enumerate(zip(self.faults, self.windows, strict=True))
        return [(number, *pair) for number, pair in pairs if pair[0].row.on in targets]

    def ground(self, terrain: Terrain, soil: SoilMap) -> tuple[Terrain, SoilMap]:
        """Return the ground with what lies across the path."""
        features = []
        patches = []
        for _, fault, window in self._on("ground"):
            x, y, yaw, *_ = self.reference.at(window.start_s).state.tolist()
            item = fault.row.effect(fault, (x, y, yaw))
            (patches if isinstance(item, Patch) else features).append(item)
        if features:
            terrain = terrain.shaped(features)
        if patches:
            soil = replace(soil, layers=(*soil.layers, *patches))
        return terrain, soil

    def disturb(self, sensors: SensorSuite, seed: int) -> None:
        """Give the faults of its samples to a suite of sensors."""
        if faults := self._on("samples"):
            specification = sensors.specification
            timestep = sensors.timestep
            sensors.changes = (SampleFaults(faults, specification, timestep, seed),)

    def damage(self, plant: Plant) -> None:
        """Give the faults of its command path to a plant that was not reset yet."""
        faults = [(fault, window) for _, fault, window in self._on("bus", "valve")]
        if faults:
            vehicle = self.context.vehicle
            timestep = plant.timestep_s
            stops_deg = vehicle.front_steering.limit_deg, vehicle.trailer_steering.limit_deg
            front, trailer = map(math.radians, stops_deg)
            plant.actuators = FaultyActuators(plant.actuators, faults, timestep, (front, trailer))

    def stages(self, plant: Plant) -> list[tuple[str, Stage]]:
        """Return the stages that work and log the faults, each after the stage of a name."""
        stages: list[tuple[str, Stage]] = []
        effects = [
            (fault.row.effect(fault, plant), window) for _, fault, window in self._on("plant")
        ]
        if effects:
            stages.append(("control", _plant_stage(effects, self.context.period_s)))
        if self.faults:
            stages.append(("advance", self._log_stage()))
        return stages

    def _log_stage(self) -> Stage:
        """Return the stage that logs starts and ends; the tick of each follows from its time."""
        events: dict[int, list[Event]] = {}
        for fault, window in zip(self.faults, self.windows, strict=True):
            for time_s, level, what in (
                (window.start_s, "warning", BEGINS),
                (window.end_s, "info", ENDS),
            ):
                if math.isfinite(time_s):
                    tick = max(math.ceil(time_s / self.context.period_s - _SAME_TIME) - 1, 0)
                    text = f"{FAULT}{fault.label}{what}"
                    events.setdefault(tick, []).append(Event(time_s, level, text))

        def log_faults(setup: SimulationSetup, tick: TickContext) -> None:
            for event in sorted(events.get(tick.k, ()), key=lambda event: event.time_s):
                setup.sink.event(event)

        return log_faults


def _plant_stage(effects: list[tuple[Effect, Window]], period_s: float) -> Stage:
    def work_faults(setup: SimulationSetup, tick: TickContext) -> None:
        setup.plant.data.qfrc_applied[:] = 0.0
        since_s = tick.k * period_s
        for effect, window in effects:
            effect(window.share(since_s, since_s + period_s))

    return work_faults
