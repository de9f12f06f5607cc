"""Composition root: from a scenario and a seed to the objects of a run."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ttempc.guidance.guidance import Guidance
from ttempc.guidance.supervisor import run_on
from ttempc.reference.path import Path
from ttempc.reference.posture import check_drivable
from ttempc.reference.projection import Projection
from ttempc.reference.reference import Reference, check_pace
from ttempc.types import FloatArray, Input
from ttempc.vehicle import Vehicle

from ...testbed.actuation.actuators import Actuators
from ...testbed.discretisation import whole_steps
from ...testbed.ground.grid import Grid
from ...testbed.ground.soil_layers import StrengthMap
from ...testbed.ground.terrain import Terrain
from ...testbed.implement.mounted import check_pull
from ...testbed.randomness import generator
from ...testbed.recording.record import Sink
from ...testbed.sensing.sensors import Sensors, SensorSuite
from ...testbed.sensing.truth_estimator import TruthEstimator
from ...testbed.simulation.loop import STAGES, with_stages
from ...testbed.simulation.plant import Plant, Snapshot
from ...testbed.simulation.setup import SimulationSetup, Stage
from ...testbed.simulation.termination import TerminationLimits
from ...testbed.vehicle.axle_loads import overload_notes
from ..errors import InvalidScenario
from ..scenario.control import ControlSettings, record_rate, record_steps
from ..scenario.controller import TRUTH
from ..scenario.mission import Mission
from ..scenario.scenario import Scenario
from ..scenario.vehicle import ParameterMismatch, Vehicles
from .corridor_judge import corridor_row
from .shared_parts import SharedParts
from .timetable import Timetable
from .user_code import is_user_code, load_factory, named_estimator, named_factory, user_stage

_COVER_STEP_M = 0.1  # between the places at which the path is looked at
_BLOCK = 4096  # rows of the reference at a time: a sample takes twice the memory of a row
EDGE_M = 4.0  # from path to edge of the field: vehicle, antenna and a metre of error


@dataclass(frozen=True)
class Assembly:
    """A run, ready to go but for the sink that listens to it."""

    plant: Plant
    sensors: Sensors
    guidance: Guidance
    terrain: Terrain
    reference: Reference  # of the plant's lengths: by it a run is judged
    start: Snapshot  # of the plant at the start of the reference, rolling
    ticks: int
    mismatch: tuple[ParameterMismatch, ...]  # between plant and model
    control: ControlSettings
    notes: tuple[str, ...] = ()  # on path, tyres and tube, for the log
    stages: tuple[Stage, ...] = STAGES
    termination: TerminationLimits | None = None  # None: those of the vehicle

    @property
    def vehicle(self) -> Vehicle:
        """Model parameters of the guidance."""
        return self.guidance.vehicle

    def setup(self, sink: Sink, record_hz: float | None = None) -> SimulationSetup:
        """Return the run with the sink in its place, the plant at its start and rolling.

        Args:
            sink: is told everything.
            record_hz: how often it is told the truth [Hz], see `record_steps`; None: as in
                `record_rate`.
        """
        self.plant.restore(self.start)
        timestep, period_s = self.plant.timestep_s, self.guidance.period_s
        record_hz = record_hz or record_rate(timestep, period_s)
        rows = self._reference_rows(record_hz)
        return SimulationSetup(
            plant=self.plant,
            sensors=self.sensors,
            guidance=self.guidance,
            vehicle=self.guidance.vehicle,
            sink=sink,
            reference=rows,
            control_steps=whole_steps(period_s, timestep, "control period"),
            record_steps=record_steps(timestep, period_s, record_hz),
            terrain=self.terrain,
            termination=self.termination or TerminationLimits.of(self.plant.vehicle),
            notes=self.notes,
            realtime=self.control.realtime,
            step_limit_s=self.control.step_limit_s,
            place=Projection(rows[:, :2]).place if self.guidance.space_based else None,
            corridor_row=corridor_row(self.reference, rows, record_hz),
        )

    def reference_path(self, step_m: float) -> FloatArray:
        """Return points on the path, one every `step_m` [m], (n, 2) [m]."""
        path = self.reference.path
        return path.pose(np.arange(0.0, path.lap_m + step_m, step_m))[:, :2]

    def _reference_rows(self, record_hz: float) -> FloatArray:
        """Return rows of `channels.REFERENCE`, one for each of the truth."""
        beyond = run_on(self.ticks) if self.guidance.space_based else 0
        count = (self.ticks + beyond) * round(self.guidance.period_s * record_hz) + 1
        times = np.arange(count) / record_hz
        parts = (times[k : k + _BLOCK] for k in range(0, len(times), _BLOCK))
        return np.concatenate([self._reference_columns(part) for part in parts])

    def _reference_columns(self, times: FloatArray) -> FloatArray:
        sample = self.reference.at(times)
        x, y, psi_t, psi_i, delta_t, delta_i, v = sample.state.T
        columns = (
            x,
            y,
            psi_t,
            sample.trailer_xy,
            psi_i,
            v,
            sample.curvature,
            sample.hitch_angle,
            delta_t,
            delta_i,
            sample.inputs[:, Input.HP],
        )
        return np.column_stack(columns)


def assemble(
    scenario: Scenario,
    seed: int,
    factory: Callable[..., object] | None = None,
    parts: SharedParts | None = None,
    guide: Callable[..., Guidance] = Guidance,
) -> Assembly:
    """Return the objects of a run.

    Args:
        scenario: what to run.
        seed: draws terrain and noise.
        factory: makes the controller from vehicle, reference, control period [s] and the options
            of the scenario; by default the one of the name `scenario.controller.name`.
        parts: of earlier runs, to be used again; none by default.
        guide: makes the guidance, called as `Guidance`; with other safety limits or detectors.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            the message says what, where and what is allowed.
    """
    mission = scenario.mission()
    vehicles = scenario.vehicles()
    vehicle = model_vehicle(mission, scenario, vehicles)
    parts = parts or SharedParts()
    terrain = parts.terrain(scenario, seed)
    reference, strength_map = _way(mission, vehicle, terrain, scenario)
    driven = replace(vehicle, **vehicles.plant_lengths)
    timestep = scenario.plant.timestep_s
    record_rate(timestep, scenario.control.period_s)
    soil = scenario.soil.soil(seed, terrain, mission.path, strength_map)
    _check_pull(scenario, vehicles, mission, soil.background)
    timetable = Timetable.of(scenario, vehicles.plant, reference, _ticks(reference, scenario))
    terrain, soil = timetable.ground(terrain, soil)
    plant = Plant(
        vehicles.plant,
        terrain,
        soil,
        wheels=scenario.plant.wheels,
        wheel_law=scenario.plant.wheel_law,
        timestep_s=timestep,
        actuators=scenario.actuators,
        implement=scenario.implement,
    )
    timetable.damage(plant)
    suite = SensorSuite(scenario.sensors, timestep, seed, plant.lever_arms)
    guidance = _guidance(scenario, reference, plant, factory, parts, guide)
    x, y, yaw, *_, speed = reference.at(0.0).state.tolist()
    plant.reset(x, y, yaw, speed)  # refused here, before anything is written
    return Assembly(
        plant=plant,
        sensors=timetable.sensors(suite, timestep, seed),
        guidance=guidance,
        terrain=terrain,
        reference=replace(reference, vehicle=driven),
        start=plant.snapshot(),
        ticks=timetable.ticks,
        mismatch=(*vehicles.mismatch, *scenario.controller.noise.mismatch(scenario.sensors)),
        notes=(
            *mission.notes,
            *overload_notes(vehicles.plant),
            *(() if factory else scenario.controller.notes(vehicle, scenario.control.period_s)),
        ),
        control=scenario.control,
        stages=with_stages([*timetable.stages(plant), *_user_stages(scenario, seed)]),
    )


def check(scenario: Scenario) -> int:
    """Refuse what `assemble` would refuse, in a fraction of its time; return the control ticks.

    Nothing is drawn, compiled or solved for: the ground is level but for its features, there is
    neither a plant nor a controller.

    Raises:
        ExperimentError, TestbedError, TtempcError: as `assemble`.
    """
    mission = scenario.mission()
    vehicles = scenario.vehicles()
    vehicle = model_vehicle(mission, scenario, vehicles)
    level = replace(scenario.terrain, iso_class="flat").terrain(seed=0)
    reference, strength_map = _way(mission, vehicle, level, scenario)
    check_drivable(mission.path, vehicle)
    check_pace(reference, scenario.control.period_s)
    _check_guidance(scenario, vehicle)
    for stage in scenario.stages:
        load_factory(stage.make, "stage")
    timestep_s = scenario.plant.timestep_s
    record_rate(timestep_s, scenario.control.period_s)
    soil = scenario.soil.soil(0, level, mission.path, strength_map)
    _check_pull(scenario, vehicles, mission, soil.background)
    front_stop = math.radians(vehicles.plant.front_steering.limit_deg)
    trailer_stop = math.radians(vehicles.plant.trailer_steering.limit_deg)
    Actuators(scenario.actuators, timestep_s, (front_stop, trailer_stop))
    SensorSuite(scenario.sensors, timestep_s, 0, np.zeros((2, 3)))
    ticks = _ticks(reference, scenario)
    ground, soil = Timetable.of(scenario, vehicles.plant, reference, ticks).ground(level, soil)
    soil.rasterised(ground)
    return ticks


def model_vehicle(mission: Mission, scenario: Scenario, vehicles: Vehicles) -> Vehicle:
    """Return the vehicle model in the gear of the mission.

    Raises:
        InvalidScenario: the vehicle has no such gear.
    """
    if mission.reverse and not vehicles.plant.hydrostat.reverse:
        raise InvalidScenario(
            f"path.reverse: vehicle {scenario.plant.vehicle.file} drives forward only; its file "
            "must say hydrostat.reverse = true"
        )
    return replace(vehicles.model, reverse=mission.reverse)


def _way(
    mission: Mission, vehicle: Vehicle, terrain: Terrain, scenario: Scenario
) -> tuple[Reference, StrengthMap | None]:
    """Return the reference, on a field and a soil map that cover it; the map, too."""
    path = mission.path
    _check_covered(path, terrain, "field", "terrain.size_x_m, size_y_m or height_map")
    strength_map = scenario.soil.strength_map()
    if strength_map:
        _check_covered(path, strength_map, "soil map", "soil.map")
    reference = Reference(path, vehicle, mission.speed, corridor=scenario.kept_corridor())
    if reference.corridor and reference.corridor.hitch_limit is not None:
        grid = reference.on_grid(scenario.control.period_s)
        reference.corridor.require_hitch(grid.hitch_angle)
    return reference, strength_map


def _check_pull(
    scenario: Scenario, vehicles: Vehicles, mission: Mission, cone_index: float
) -> None:
    if scenario.implement:
        law, speed = scenario.plant.wheel_law, mission.speed.top_speed
        check_pull(law, scenario.implement, vehicles.plant, cone_index, speed)


def _ticks(reference: Reference, scenario: Scenario) -> int:
    return math.ceil(reference.duration_s / scenario.control.period_s - 1e-9)


def _guidance(
    scenario: Scenario,
    reference: Reference,
    plant: Plant,
    factory: Callable[..., object] | None,
    parts: SharedParts,
    guide: Callable[..., Guidance],
) -> Guidance:
    """Return estimator, controller and supervisor of a scenario as one object."""
    settings, vehicle = scenario.controller, reference.vehicle
    period_s = scenario.control.period_s
    noise = settings.noise.sensor_noise(scenario.sensors)
    controller = parts.controller_factory(scenario, vehicle, factory)
    if settings.estimator == TRUTH:
        estimator = TruthEstimator(plant.truth, vehicle)
    else:
        estimator = partial(named_estimator, settings.estimator)
    # The disturbances of the true state are those beside the given lengths: there is none to learn.
    learn = settings.learn and settings.estimator != TRUTH
    return guide(
        vehicle, reference, period_s, controller, estimator, sensor_noise=noise, learn=learn
    )


def _user_stages(scenario: Scenario, seed: int) -> list[tuple[str, Stage]]:
    """Return the stages of the scenario, each with its own generator, and where they stand."""
    stages = []
    for number, settings in enumerate(scenario.stages):
        draws = generator(seed, f"stage {number} {settings.make}")
        stages.append((settings.after, user_stage(settings, draws)))
    return stages


def _check_guidance(scenario: Scenario, vehicle: Vehicle) -> None:
    """Refuse names, options and tubes that `_guidance` would refuse; make no controller."""
    settings = scenario.controller
    named_factory(settings.name, settings.options)
    settings.design(vehicle, scenario.control.period_s)
    if is_user_code(settings.estimator):
        load_factory(settings.estimator, "estimator")


def _check_covered(path: Path, grid: Grid, what: str, keys: str) -> None:
    """Refuse a path that comes too near to an edge of the field, or of a map of its soil.

    Raises:
        InvalidScenario: with the path's box, the grid's, the margin and the first place within it.
    """
    along = np.linspace(0.0, path.lap_m, math.ceil(path.lap_m / _COVER_STEP_M) + 1)
    x, y, _ = path.pose(along).T
    beyond = np.flatnonzero(~grid.inside(x, y, EDGE_M))
    if len(beyond):
        first, box = beyond[0], path.extent()
        (left, low), (width, height) = grid.origin, grid.size_m
        raise InvalidScenario(
            f"path: leaves at s = {along[first]:.1f} m (x = {x[first]:.1f}, y = {y[first]:.1f} m), "
            f"reaches from ({box.x_min:.1f}, {box.y_min:.1f}) to "
            f"({box.x_max:.1f}, {box.y_max:.1f}) m; it must stay {EDGE_M:g} m inside the {what}, "
            f"which reaches from ({left:.1f}, {low:.1f}) to ({left + width:.1f}, "
            f"{low + height:.1f}) m ({keys})"
        )
