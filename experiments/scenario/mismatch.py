"""Parameters in which the plant differs from what estimator and controller assume."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from typing import Final

from ...testbed.actuation.actuators import ActuatorSpecification, SteeringValve
from ...testbed.sensing.sensor_specification import SensorSpecification
from .vehicle import PARAMETERS, ModelVehicleSettings, ParameterMismatch

_AXES: Final = {"front": "dead_time_t", "trailer": "dead_time_i", "hydrostat": "dead_time_hp"}

KEY_OF_FIELD: Final[Mapping[str, str]] = {
    **{item.field: key for key, item in PARAMETERS.items() if item.field},
    **{field: f"{axis}_dead_time_s" for axis, field in _AXES.items()},
}
"""Key of a scenario for each field of `ttempc.vehicle.Vehicle` that may be learnt."""


def actuator_mismatch(
    plant: ActuatorSpecification, model: ModelVehicleSettings
) -> Iterator[ParameterMismatch]:
    """Yield dead times that the model has otherwise, and flaws of valves that it does not have."""
    ideal = asdict(SteeringValve())
    for axis in _AXES:
        for key, value in asdict(getattr(plant, axis)).items():
            name = f"actuators.{axis}.{key}"
            assumed = ideal[key]
            if key == "dead_time_s":
                name = f"{axis}_dead_time_s"
                assumed = getattr(model, name)
            if value != assumed:
                yield ParameterMismatch(name, value, assumed)


def sensor_mismatch(sensors: SensorSpecification) -> Iterator[ParameterMismatch]:
    """Yield the resolutions of sensors that their noise does not hide.

    The estimator takes samples for continuous. Noise, offsets and biases are those of
    `NoiseSettings.mismatch`, delays are known by the time stamps of the samples.
    """
    for name, table in (("sensors", sensors), ("sensors.imu", sensors.imu)):
        values = asdict(table)
        for key, value in values.items():
            if "_resolution_" in key and value > values[key.replace("_resolution_", "_sd_")]:
                yield ParameterMismatch(f"{name}.{key}", value, 0.0)
