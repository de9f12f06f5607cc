"""From a scenario and a seed to the objects that a run is made of."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from proving_ground.testbed.actuation.actuators import Actuators
from proving_ground.testbed.discretisation import whole_steps
from proving_ground.testbed.ground.grid import Grid
from proving_ground.testbed.ground.soil_layers import StrengthMap
from proving_ground.testbed.ground.terrain import Terrain
from proving_ground.testbed.recording.sink import Sink
from proving_ground.testbed.sensing.sensors import SensorSuite
from proving_ground.testbed.sensing.truth_estimator import TruthEstimator
from proving_ground.testbed.simulation.loop import Rig
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.simulation.termination import TerminationLimits
from ttempc.baselines.nmhe import MovingHorizonEstimator
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.guidance.supervisor import Supervisor
from ttempc.reference.path import Path
from ttempc.reference.posture import check_drivable
from ttempc.reference.reference import Reference, check_pace
from ttempc.types import Controller, Estimator, FloatArray
from ttempc.vehicle import Vehicle

from ..errors import InvalidScenario
from ..scenario.assumed_noise import assumed_noise
from ..scenario.mission import Mission
from ..scenario.scenario import Scenario
from ..scenario.vehicle import ParameterMismatch, Vehicles
from .controller_factory import ControllerFactory, controller_factory

CONTROL_PERIOD_S = 0.2  # 5 Hz; paper, sec. II
RECORD_RATE_HZ = 25.0  # of the paper's fastest sensors
_COVER_STEP_M = 0.1  # between the places at which the path is looked at
EDGE_M = 4.0  # from path to edge of the field: vehicle, antenna and a metre of error


@dataclass(frozen=True)
class Assembly:
    """A run, ready to go but for the sink that listens to it."""

    plant: Plant
    sensors: SensorSuite
    estimator: Estimator
    controller: Controller
    vehicle: Vehicle  # of the model
    terrain: Terrain
    reference: Reference
    ticks: int
    mismatch: tuple[ParameterMismatch, ...]  # between plant and model
    notes: tuple[str, ...] = ()  # on the path, for the log

    def rig(self, sink: Sink, record_hz: float = RECORD_RATE_HZ) -> Rig:
        """Return the run with the sink in its place, the plant at its start and rolling.

        Args:
            sink: is told everything.
            record_hz: how often it is told the truth [Hz]; see `record_steps`.
        """
        start = self.reference.at(0.0)
        x, y, yaw = start.state[:3]
        self.plant.reset(float(x), float(y), float(yaw), float(start.state[6]))
        timestep = self.plant.timestep_s
        return Rig(
            plant=self.plant,
            sensors=self.sensors,
            estimator=self.estimator,
            controller=self.controller,
            vehicle=self.vehicle,
            sink=sink,
            reference=self._reference_rows(record_hz),
            control_steps=whole_steps(CONTROL_PERIOD_S, timestep, "control period"),
            record_steps=record_steps(timestep, record_hz),
            terrain=self.terrain,
            mishaps=TerminationLimits.of(self.plant.vehicle),
            notes=self.notes,
        )

    def reference_path(self, step_m: float) -> FloatArray:
        """Return points on the path, one every `step_m` [m], (n, 2) [m]."""
        path = self.reference.path
        return path.pose(np.arange(0.0, path.lap_m + step_m, step_m))[:, :2]

    def _reference_rows(self, record_hz: float) -> FloatArray:
        """Return rows of `channels.REFERENCE`, one for each of the truth."""
        count = self.ticks * round(CONTROL_PERIOD_S * record_hz) + 1
        sample = self.reference.at(np.arange(count) / record_hz)
        x, y, psi_t, psi_i, delta_t, delta_i, v = sample.state.T
        return np.column_stack(
            [
                *(x, y, psi_t, sample.trailer_xy, psi_i, v, sample.curvature),
                *(sample.hitch_angle, delta_t, delta_i, sample.inputs[:, 2]),
            ]
        )


def assemble(scenario: Scenario, seed: int, factory: ControllerFactory | None = None) -> Assembly:
    """Return the objects of a run.

    Args:
        scenario: what to run.
        seed: draws terrain and noise.
        factory: makes the controller from vehicle, reference and control period [s]; by default
            the one of the name `scenario.controller.name`.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            the message says what, where and what is allowed.
    """
    mission = scenario.path.mission()
    vehicles = scenario.vehicles()
    vehicle = model_vehicle(mission, scenario, vehicles)
    terrain = scenario.terrain.terrain(seed)
    reference, strength_map = _way(mission, vehicle, terrain, scenario)
    asked = scenario.controller
    factory = factory or controller_factory(asked.name, asked.design(vehicle, CONTROL_PERIOD_S))
    controller = factory(vehicle, reference, CONTROL_PERIOD_S)
    controller = Supervisor(controller, vehicle, reference, CONTROL_PERIOD_S)
    timestep = scenario.plant.timestep_s
    record_steps(timestep, RECORD_RATE_HZ)
    soil = scenario.soil.soil(seed, terrain, mission.path, strength_map)
    plant = Plant(
        vehicles.plant,
        terrain,
        soil,
        wheels=scenario.plant.wheels,
        timestep_s=timestep,
        actuators=scenario.actuators,
    )
    sensors = SensorSuite(scenario.sensors, timestep, seed, plant.lever_arms)
    estimator = _estimator(scenario, vehicle, plant)
    ticks = _ticks(reference)
    return Assembly(
        *(plant, sensors, estimator, controller, vehicle, terrain, reference, ticks),
        mismatch=vehicles.mismatch,
        notes=mission.notes,
    )


def check(scenario: Scenario) -> int:
    """Refuse what `assemble` would refuse, in a fraction of its time; return the control ticks.

    Nothing is drawn, compiled or solved for: the ground is level but for its features, there is
    neither a plant nor a controller.

    Raises:
        ExperimentError, TestbedError, TtempcError: as `assemble`.
    """
    mission = scenario.path.mission()
    vehicles = scenario.vehicles()
    vehicle = model_vehicle(mission, scenario, vehicles)
    level = replace(scenario.terrain, iso_class="flat").terrain(seed=0)
    reference, strength_map = _way(mission, vehicle, level, scenario)
    asked = scenario.controller
    controller_factory(asked.name, asked.design(vehicle, CONTROL_PERIOD_S))
    timestep_s = scenario.plant.timestep_s
    record_steps(timestep_s, RECORD_RATE_HZ)
    scenario.soil.soil(0, level, mission.path, strength_map)
    front_stop = math.radians(vehicles.plant.front_steering.limit_deg)
    trailer_stop = math.radians(vehicles.plant.trailer_steering.limit_deg)
    Actuators(scenario.actuators, timestep_s, (front_stop, trailer_stop))
    SensorSuite(scenario.sensors, timestep_s, 0, np.zeros((2, 3)))
    return _ticks(reference)


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
    check_drivable(path, vehicle)
    reference = Reference(path, vehicle, mission.speed)
    check_pace(reference, CONTROL_PERIOD_S)
    return reference, strength_map


def _ticks(reference: Reference) -> int:
    return math.ceil(reference.duration_s / CONTROL_PERIOD_S - 1e-9)


def record_steps(timestep_s: float, record_hz: float) -> int:
    """Return the physics steps from one row of the truth to the next.

    Raises:
        InvalidScenario: a control period does not hold a whole number of rows.
    """
    what = f"plant.timestep_s = {timestep_s}: control period"
    control_steps = whole_steps(CONTROL_PERIOD_S, timestep_s, what)
    rows = round(CONTROL_PERIOD_S * record_hz) if math.isfinite(record_hz) else 0
    exact = abs(rows - CONTROL_PERIOD_S * record_hz) < 1e-9
    if rows < 1 or not exact or control_steps % rows:
        allowed = (n / CONTROL_PERIOD_S for n in range(1, control_steps + 1))
        rates = [f"{hz:g}" for n, hz in enumerate(allowed, 1) if control_steps % n == 0]
        raise InvalidScenario(
            f"record rate: got {record_hz:g} Hz, must be one of {', '.join(rates)} Hz, so that "
            f"rows fall on physics steps of {1e3 * timestep_s:g} ms and on control ticks"
        )
    return control_steps // rows


def _estimator(scenario: Scenario, vehicle: Vehicle, plant: Plant) -> Estimator:
    noise = assumed_noise(scenario.sensors)
    match scenario.controller.estimator:
        case "truth":
            return TruthEstimator(plant.truth)
        case "ekf":
            return ExtendedKalmanFilter(vehicle, noise)
        case "nmhe":
            return MovingHorizonEstimator(vehicle, noise)


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
