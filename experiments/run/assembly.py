"""Composition root: from a scenario and a seed to the objects of a run."""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Final

import numpy as np

from ttempc.guidance.guidance import Guidance
from ttempc.guidance.pipeline import ControllerFactory
from ttempc.guidance.settings import GuidanceSettings
from ttempc.guidance.supervisor import run_on
from ttempc.reference.path import Path, Projection
from ttempc.reference.reference import Reference, ReferenceSample, check_drivable, check_pace
from ttempc.reference.towed import distance_off_line
from ttempc.types import FloatArray, Input
from ttempc.vehicle import Vehicle

from ...testbed.actuation.actuators import Actuators
from ...testbed.discretisation import whole_steps
from ...testbed.geodesy import DEFAULT_FRAME, MapFrame
from ...testbed.ground.grid import Grid
from ...testbed.ground.soil import SoilMap
from ...testbed.ground.terrain import Terrain
from ...testbed.implement.implement import Implement
from ...testbed.implement.mounted import check_pull
from ...testbed.randomness import generator
from ...testbed.recording.channels import CORRIDOR, LINE
from ...testbed.recording.record import RESUMED, Event, Sink
from ...testbed.sensing.sensors import SensorSuite
from ...testbed.sensing.truth_estimator import TruthEstimator
from ...testbed.simulation.deadline import Deadline
from ...testbed.simulation.loop import STAGES, with_stages
from ...testbed.simulation.plant import Plant, Snapshot
from ...testbed.simulation.setup import SimulationSetup, Stage, TickContext
from ...testbed.simulation.termination import TerminationLimits
from ...testbed.vehicle.vehicle import GRAVITY, AxleLoads, PlantVehicle
from ..errors import InvalidScenario
from ..scenario.controller import TRUTH
from ..scenario.mismatch import actuator_mismatch, sensor_mismatch
from ..scenario.path import Mission
from ..scenario.plant import ControlSettings, record_rate, record_steps
from ..scenario.scenario import Scenario
from ..scenario.vehicle import ParameterMismatch, Vehicles
from .corridor_judge import CorridorJudge
from .line_judge import LineJudge
from .shared_parts import SharedParts
from .timetable import Timetable
from .user_code import is_user_code, load_factory, named_estimator, named_factory, user_stage

if TYPE_CHECKING:
    from ...testbed.messages.scenery import Scenery


# Share of the side stiffness of tyres, which is that of slips of 0.01 rad, that is left where a
# trailer turns about a place behind its axle, with several times that slip; assumed
_STIFFNESS_LEFT: Final = 0.5
_COVER_STEP_M = 0.1  # between the places at which the path is looked at
_BLOCK = 4096  # rows of the reference at a time: a sample takes twice the memory of a row
EDGE_M = 4.0  # from path to edge of the field: vehicle, antenna and a metre of error


@dataclass(frozen=True)
class Assembly:
    """A run, ready to go but for the sink that listens to it."""

    plant: Plant
    sensors: SensorSuite
    guidance: Guidance
    terrain: Terrain
    reference: Reference  # of the plant's lengths: by it a run is judged
    start: Snapshot  # of the plant at the start of the reference, rolling
    ticks: int
    mismatch: tuple[ParameterMismatch, ...]  # between plant and model
    control: ControlSettings
    frame: MapFrame = DEFAULT_FRAME  # place of the map on the earth
    notes: tuple[str, ...] = ()  # on path and tube, for the log
    line: FloatArray | None = None  # as given (n, 2) [m], where the reference is beside it
    stages: tuple[Stage, ...] = STAGES
    termination: TerminationLimits | None = None  # None: those of the vehicle

    @property
    def scenery(self) -> "Scenery":
        """Static data for viewers, placed on the earth."""
        return replace(self.plant.scenery, frame=self.frame)

    @property
    def vehicle(self) -> Vehicle:
        """Model parameters of the guidance."""
        return self.guidance.vehicle

    def setup(self, sink: Sink, record_hz: float | None = None) -> SimulationSetup:
        """Return the run with a sink that is told everything, the plant at its start and rolling.

        `record_hz` is how often it is told the truth, see `record_steps`; None: as `record_rate`.
        """
        self.plant.restore(self.start)
        timestep = self.plant.timestep_s
        period_s = self.guidance.period_s
        record_hz = record_hz or record_rate(timestep, period_s)
        rows = self._reference_rows(record_hz)
        corridor = self.reference.corridor
        distance, _, _ = self.reference.speed.travel(np.arange(len(rows)) / record_hz)
        return SimulationSetup(
            plant=self.plant,
            sensors=self.sensors,
            guidance=self.guidance,
            sink=sink,
            reference=rows,
            control_steps=whole_steps(period_s, timestep, "control period"),
            record_steps=record_steps(timestep, period_s, record_hz),
            terrain=self.terrain,
            termination=self.termination or TerminationLimits.of(self.plant.vehicle),
            notes=self.notes,
            realtime=self.control.realtime,
            deadline=Deadline(self.control.step_limit_s),
            place=Projection(rows[:, :2]).place if self.guidance.space_based else None,
            judges=tuple(
                (channel, judge)
                for channel, judge in (
                    (CORRIDOR, corridor and CorridorJudge(corridor, rows, distance).rows),
                    (LINE, None if self.line is None else LineJudge(self.line).rows),
                )
                if judge is not None
            ),
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
        return np.concatenate([_reference_columns(self.reference.at(part)) for part in parts])


def _reference_columns(sample: ReferenceSample) -> FloatArray:
    x, y, psi_t, psi_i, delta_t, delta_i, v = sample.state.T
    trailer = sample.trailer_xy
    hitch = sample.hitch_angle
    hp = sample.inputs[:, Input.HP]
    columns = (x, y, psi_t, trailer, psi_i, v, sample.curvature, hitch, delta_t, delta_i, hp)
    return np.column_stack(columns)


@dataclass(frozen=True)
class _Plan:
    mission: Mission
    vehicles: Vehicles
    reference: Reference  # with the lengths of the controller's model
    terrain: Terrain
    soil: SoilMap
    timetable: Timetable


def assemble(
    scenario: Scenario,
    seed: int,
    factory: Callable[..., object] | None = None,
    parts: SharedParts | None = None,
    kind: type[Guidance] = Guidance,
    adjust: Callable[[GuidanceSettings], GuidanceSettings] = lambda settings: settings,
) -> Assembly:
    """Return the objects of a run.

    Args:
        scenario: what to run.
        seed: draws terrain and noise.
        factory: makes the controller from vehicle, reference, control period [s] and the options
            of the scenario; by default the one of the name `scenario.controller.name`.
        parts: of earlier runs, to be used again; none by default.
        kind: type of the guidance.
        adjust: changes the settings that the scenario gives the guidance, such as safety limits.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            the message says what, where and what is allowed.
    """
    parts = parts or SharedParts()
    plan = _plan(scenario, seed, parts.terrain)

    # Plant and sensors, with their faults
    plant = _plant(scenario, plan, seed)
    plan.timetable.damage(plant)
    sensors = SensorSuite(scenario.sensors, plant.timestep_s, seed, plant.lever_arms)
    plan.timetable.disturb(sensors, seed)

    # Guidance, and stages of the user's
    vehicle = plan.reference.vehicle
    controller = parts.controller_factory(scenario, vehicle, factory)
    guidance = _guidance(scenario, plan, plant, controller, kind, adjust)
    user_stages = _user_stages(scenario, seed)

    # The start, refused here, before anything is written
    x, y, yaw, *_, speed = plan.reference.at(0.0).state.tolist()
    begin = scenario.start
    plant.reset(*begin.pose(x, y, yaw), speed if begin.rolling else 0.0)

    # What judges the run has the lengths of the plant
    judged = replace(plan.reference, vehicle=replace(vehicle, **plan.vehicles.plant_lengths))
    off_line_m = distance_off_line(judged.path, judged.vehicle)
    return Assembly(
        plant=plant,
        sensors=sensors,
        guidance=guidance,
        terrain=plan.terrain,
        reference=judged,
        start=plant.snapshot(),
        ticks=plan.timetable.ticks,
        mismatch=(
            *plan.vehicles.mismatch,
            *actuator_mismatch(scenario.actuators, scenario.controller.vehicle),
            *scenario.controller.noise.mismatch(scenario.sensors),
            *sensor_mismatch(scenario.sensors),
        ),
        notes=(
            *plan.mission.notes,
            *_on_trailer(vehicle, off_line_m),
            *(() if factory else scenario.controller.notes(vehicle, scenario.control.period_s)),
        ),
        control=scenario.control,
        frame=plan.mission.frame,
        line=plan.mission.line if off_line_m == 0.0 else plan.mission.driven_line(),
        stages=with_stages(
            [*_operator(scenario.control), *plan.timetable.stages(plant), *user_stages]
        ),
    )


def _plant(scenario: Scenario, plan: _Plan, seed: int) -> Plant:
    """Return the plant of a run without faults."""
    tool = scenario.implement
    return Plant(
        plan.vehicles.plant,
        plan.terrain,
        plan.soil,
        wheel_law=scenario.plant.wheel_law,
        timestep_s=scenario.plant.timestep_s,
        actuators=scenario.actuators,
        implement=tool,
        draft_variation=tool and tool.variation(generator(seed, "draft"), plan.terrain),
    )


def _user_stages(scenario: Scenario, seed: int) -> list[tuple[str, Stage]]:
    """Return the stages of the user's, each after the name of another one."""
    return [
        (stage.after, user_stage(stage, generator(seed, f"stage {number} {stage.make}")))
        for number, stage in enumerate(scenario.stages)
    ]


def _on_trailer(vehicle: Vehicle, off_line_m: float) -> tuple[str, ...]:
    """Return what a user has to know of a trailer that leaves its line; nothing of another."""
    if off_line_m == 0.0:
        return ()
    steered = "has no steering"
    if vehicle.steering_limit_i:
        steered = f"steers up to {math.degrees(vehicle.steering_limit_i):.0f} deg"
    return (
        f"trailer: it {steered}, and its reference leaves the line of the tractor by up to "
        f"{100.0 * off_line_m:.0f} cm",
    )


def _operator(control: ControlSettings) -> list[tuple[str, Stage]]:
    ticks = {math.ceil(time_s / control.period_s - 1e-9) for time_s in control.resume_s}

    def operate(setup: SimulationSetup, tick: TickContext) -> None:
        if tick.k in ticks:
            setup.guidance.resume()
            setup.sink.event(Event(tick.now.time_s, "info", RESUMED))

    return [("estimate", operate)] if ticks else []


def check(scenario: Scenario) -> int:
    """Refuse what `assemble` would refuse, in a fraction of its time; return the control ticks.

    Nothing is drawn, compiled or solved for: there is neither a plant nor a controller.
    """
    plan = _plan(scenario, 0, lambda of, seed: replace(of.terrain, iso_class="flat").terrain(seed))
    settings = scenario.controller
    vehicle = plan.reference.vehicle
    check_drivable(plan.mission.path, vehicle)
    check_pace(plan.reference, scenario.control.period_s)
    named_factory(settings.name, settings.options)
    settings.design(vehicle, scenario.control.period_s)
    if is_user_code(settings.estimator):
        load_factory(settings.estimator, "estimator")
    for stage in scenario.stages:
        load_factory(stage.make, "stage")
    timestep_s = scenario.plant.timestep_s
    plant = plan.vehicles.plant
    steering = plant.front_steering, plant.trailer_steering
    Actuators(scenario.actuators, timestep_s, steering)
    SensorSuite(scenario.sensors, timestep_s, 0, np.zeros((2, 3)))
    plan.soil.rasterised(plan.terrain)
    return plan.timetable.ticks


def _plan(scenario: Scenario, seed: int, make_terrain: Callable[[Scenario, int], Terrain]) -> _Plan:
    """Return reference and ground of a run: field and soil map cover the path, faults included."""
    control = scenario.control
    mission = scenario.mission()
    vehicles = scenario.vehicles()
    vehicle = model_vehicle(mission, scenario, vehicles)
    if scenario.path.on_line == "working-point":
        mission = mission.led_by(vehicle, scenario.path.max_deviation_m)
    terrain = make_terrain(scenario, seed)
    strength_map = scenario.soil.strength_map()
    _check_covered(mission.path, terrain, "field", "terrain.size_x_m, size_y_m or height_map")
    if strength_map:
        _check_covered(mission.path, strength_map, "soil map", "soil.map")
    corridor = scenario.kept_corridor()
    reference = Reference(mission.path, vehicle, mission.speed, corridor=corridor)
    if corridor and corridor.hitch_limit is not None:
        corridor.require_hitch(reference.on_grid(control.period_s).hitch_angle)
    record_rate(scenario.plant.timestep_s, control.period_s)
    soil = scenario.soil.soil(seed, terrain, mission.path, strength_map)
    if scenario.implement:
        law = scenario.plant.wheel_law
        speed = mission.speed.top_speed
        check_pull(law, scenario.implement, vehicles.plant, soil.background, speed)
    ticks = math.ceil(reference.duration_s / control.period_s - 1e-9)
    timetable = Timetable.of(scenario, vehicles.plant, reference, ticks, seed)
    return _Plan(mission, vehicles, reference, *timetable.ground(terrain, soil), timetable)


def model_vehicle(mission: Mission, scenario: Scenario, vehicles: Vehicles) -> Vehicle:
    """Return the vehicle model in the gear of the mission."""
    if mission.reverse and not vehicles.plant.hydrostat.reverse:
        raise InvalidScenario(
            f"path.reverse: vehicle {scenario.plant.vehicle.file} drives forward only; its file "
            "must say hydrostat.reverse = true"
        )
    model = vehicles.model
    tool = scenario.implement
    if tool is None:
        return replace(model, reverse=mission.reverse)
    offset = _turning_offset(tool, vehicles.nominal)  # until it is learnt
    return replace(
        model,
        reverse=mission.reverse,
        trailer_turning_offset=offset,
        tool_behind=tool.behind_m,
    )


def _turning_offset(tool: Implement, nominal: PlantVehicle) -> float:
    """Return the distance behind the axle of the place about which a trailer with a tool turns [m].

    A turn about a place c behind the axle moves the tyres across the trailer in proportion to c and
    the tool, b behind them, the other way in proportion to b - c. Their side forces, of stiffnesses
    K_a and K_b [N/rad], are in balance for c = b K_b / (K_a + K_b). K_a is the mass on the axle
    over its cornering compliance, both of the vehicle file; 0 where this is not known.
    """
    compliance = nominal.trailer.compliance_s2pm
    if compliance == 0.0:
        return 0.0
    of_tyres = AxleLoads.of(nominal).trailer / GRAVITY / compliance
    of_tool = math.degrees(tool.side_stiffness_n_per_deg_m2) * tool.width_m * tool.depth_m
    return tool.behind_m * of_tool / (of_tool + _STIFFNESS_LEFT * of_tyres)


def _guidance(
    scenario: Scenario,
    plan: _Plan,
    plant: Plant,
    controller: ControllerFactory,
    kind: type[Guidance],
    adjust: Callable[[GuidanceSettings], GuidanceSettings],
) -> Guidance:
    settings = scenario.controller
    vehicle = plan.reference.vehicle
    estimator = partial(named_estimator, settings.estimator)
    true_state = settings.estimator == TRUTH
    if true_state:
        estimator = TruthEstimator(plant.truth, vehicle)
    given = GuidanceSettings(
        sensor_noise=settings.noise.sensor_noise(scenario.sensors),
        # The disturbances of the true state are those beside the given lengths: none to learn.
        learn=settings.learn and not true_state,
        learn_field=settings.learn_field,
        foresee=settings.foresee,
        detect=settings.detect,
        compensate=settings.compensate,
    )
    period_s = scenario.control.period_s
    return kind(vehicle, plan.reference, period_s, controller, estimator, adjust(given))


def _check_covered(path: Path, grid: Grid, what: str, keys: str) -> None:
    """Refuse a path that comes too near to an edge of the field, or of a map of its soil."""
    along = np.linspace(0.0, path.lap_m, math.ceil(path.lap_m / _COVER_STEP_M) + 1)
    x, y, _ = path.pose(along).T
    beyond = np.flatnonzero(~grid.inside(x, y, EDGE_M))
    if len(beyond):
        first = beyond[0]
        box = path.extent()
        left, low = grid.origin
        width, height = grid.size_m
        raise InvalidScenario(
            f"path: leaves at s = {along[first]:.1f} m (x = {x[first]:.1f}, y = {y[first]:.1f} m), "
            f"reaches from ({box.x_min:.1f}, {box.y_min:.1f}) to "
            f"({box.x_max:.1f}, {box.y_max:.1f}) m; it must stay {EDGE_M:g} m inside the {what}, "
            f"which reaches from ({left:.1f}, {low:.1f}) to ({left + width:.1f}, "
            f"{low + height:.1f}) m ({keys})"
        )
