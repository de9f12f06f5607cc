"""From a scenario and a seed to the objects that a run is made of."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from pathlib import Path as FilePath

import numpy as np

from experiments.errors import InvalidScenario
from experiments.scenario import FigureEight, Scenario, SoilSettings, TerrainSettings
from testbed.loop import Rig
from testbed.oracle import TruthEstimator
from testbed.plant import Plant
from testbed.randomness import generator
from testbed.sensors import SensorSpecification, SensorSuite, whole_steps
from testbed.sink import Sink
from testbed.soil import Patch, SoilMap
from testbed.terrain import Terrain, flat, from_file, rough
from testbed.vehicle_model import PlantVehicle
from ttempc.controllers import make_controller
from ttempc.estimator import ExtendedKalmanFilter
from ttempc.following import check_drivable
from ttempc.noise import SensorNoise
from ttempc.path import Path, figure_eight, straight
from ttempc.reference import ConstantSpeed, Reference
from ttempc.types import Controller, Estimator, FloatArray
from ttempc.vehicle import Vehicle

CONTROL_PERIOD_S = 0.2  # 5 Hz; paper, sec. II
RECORD_PERIOD_S = 0.04  # the period of the paper's fastest sensors
EDGE_M = 4.0  # from path to edge of the field: vehicle, antenna and a metre of error


@dataclass(frozen=True)
class Assembly:
    """A run, ready to go but for the sink that listens to it."""

    plant: Plant
    sensors: SensorSuite
    estimator: Estimator
    controller: Controller
    vehicle: Vehicle
    terrain: Terrain
    reference: Reference
    ticks: int

    def rig(self, sink: Sink) -> Rig:
        """Return the run with the sink in its place, the plant at its start and rolling."""
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
            reference=self._reference_rows(),
            control_steps=whole_steps(CONTROL_PERIOD_S, timestep, "control period"),
            record_steps=whole_steps(RECORD_PERIOD_S, timestep, "record period"),
            terrain=self.terrain,
        )

    def reference_path(self, step_m: float) -> FloatArray:
        """Return points on the path, one every `step_m` [m], (n, 2) [m]."""
        path = self.reference.path
        return path.pose(np.arange(0.0, path.lap_m + step_m, step_m))[:, :2]

    def _reference_rows(self) -> FloatArray:
        """Return rows of `channels.REFERENCE`, one every record period."""
        count = self.ticks * round(CONTROL_PERIOD_S / RECORD_PERIOD_S) + 1
        sample = self.reference.at(np.arange(count) * RECORD_PERIOD_S)
        x, y, psi_t, psi_i, delta_t, delta_i, v = sample.state.T
        return np.column_stack(
            [
                *(x, y, psi_t, sample.trailer_xy, psi_i, v, sample.curvature),
                *(sample.hitch_angle, delta_t, delta_i, sample.inputs[:, 2]),
            ]
        )


def assemble(scenario: Scenario, seed: int) -> Assembly:
    """Return the objects of a run.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            the message says what, where and what is allowed.
    """
    vehicle = _believed(scenario)
    path = _path(scenario)
    check_drivable(path, vehicle)
    reference = Reference(path, vehicle, ConstantSpeed(scenario.path.speed_mps))
    controller = make_controller(scenario.controller.name, vehicle, reference, CONTROL_PERIOD_S)
    timestep = scenario.plant.timestep_s
    for what, period in (("control", CONTROL_PERIOD_S), ("record", RECORD_PERIOD_S)):
        whole_steps(period, timestep, f"plant.timestep_s = {timestep}: {what} period")
    specification = _sensors(scenario)
    sensors = SensorSuite(specification, timestep, seed)
    terrain = _terrain(scenario.terrain, seed)
    _check_on_field(path, terrain)
    plant = Plant(
        PlantVehicle(**asdict(scenario.plant.vehicle)),
        terrain,
        _soil(scenario.soil),
        wheels=scenario.plant.wheels,
        timestep_s=timestep,
    )
    estimator: Estimator = (
        TruthEstimator(plant.truth)
        if scenario.controller.estimator == "truth"
        else ExtendedKalmanFilter(vehicle, _believed_noise(specification))
    )
    ticks = math.ceil(reference.duration_s / CONTROL_PERIOD_S - 1e-9)
    return Assembly(plant, sensors, estimator, controller, vehicle, terrain, reference, ticks)


def _believed(scenario: Scenario) -> Vehicle:
    believed = scenario.controller.vehicle
    return Vehicle(
        wheelbase=believed.wheelbase_m,
        hitch_offset=believed.hitch_offset_m,
        drawbar_length=believed.drawbar_m,
        trailer_length=believed.trailer_m,
        speed_gain=believed.speed_gain_mps,
        speed_time_constant=believed.speed_time_constant_s,
    )


def _path(scenario: Scenario) -> Path:
    settings = scenario.path
    if isinstance(settings, FigureEight):
        return figure_eight(
            settings.radius_m, settings.centre_distance_m, settings.blend_m, settings.laps
        )
    return straight(settings.length_m)


def _sensors(scenario: Scenario) -> SensorSpecification:
    settings = scenario.sensors
    return SensorSpecification(
        gnss_rate=settings.gnss_rate_hz,
        gnss_sd=settings.gnss_sd_m,
        angle_rate=settings.angle_rate_hz,
        angle_sd=math.radians(settings.angle_sd_deg),
        encoder_rate=settings.encoder_rate_hz,
        encoder_sd=settings.encoder_sd_mps,
    )


def _believed_noise(specification: SensorSpecification) -> SensorNoise:
    """Return the noise that the filter assumes: the true one, but never none at all.

    A sensor without noise would leave the filter nothing to weigh it by.
    """
    least = SensorNoise(gnss=1e-3, steering=1e-3, hitch=1e-3, encoder=1e-3)
    return SensorNoise(
        gnss=max(specification.gnss_sd, least.gnss),
        steering=max(specification.angle_sd, least.steering),
        hitch=max(specification.angle_sd, least.hitch),
        encoder=max(specification.encoder_sd, least.encoder),
    )


def _terrain(settings: TerrainSettings, seed: int) -> Terrain:
    size, spacing = (settings.size_x_m, settings.size_y_m), settings.spacing_m
    if settings.height_map:
        ground = from_file(FilePath(settings.height_map), spacing)
    elif settings.iso_class == "flat":
        ground = flat(size, spacing)
    else:
        ground = rough(settings.iso_class, generator(seed, "terrain"), size, spacing)
    return ground.tilted(settings.slope_rad, math.radians(settings.uphill_deg))


def _soil(settings: SoilSettings) -> SoilMap:
    return SoilMap(
        settings.cone_index_kpa,
        tuple(
            Patch.circle(patch.x_m, patch.y_m, patch.radius_m, patch.cone_index_kpa)
            for patch in settings.patches
        ),
    )


def _check_on_field(path: Path, terrain: Terrain) -> None:
    """Refuse a path that comes too near to an edge of the field.

    Raises:
        InvalidScenario: with the path's box, the field's and the margin.
    """
    box = path.extent()
    corners = np.array([[box.x_min, box.y_min], [box.x_max, box.y_max]])
    if not terrain.contains(corners[:, 0], corners[:, 1], EDGE_M):
        (x, y), (width, height) = terrain.origin, terrain.size_m
        raise InvalidScenario(
            f"path: reaches from ({box.x_min:.1f}, {box.y_min:.1f}) to "
            f"({box.x_max:.1f}, {box.y_max:.1f}) m; it must stay {EDGE_M:g} m inside the field, "
            f"which reaches from ({x:.1f}, {y:.1f}) to ({x + width:.1f}, {y + height:.1f}) m "
            "(terrain.size_x_m, terrain.size_y_m)"
        )
