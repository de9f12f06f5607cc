"""`[controller]` and `[[stages]]`: controller, estimator, their model, and stages of a user."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import Field, ValidationError
from pydantic.dataclasses import dataclass

from ttempc.detectors.monitors import chosen
from ttempc.errors import InvalidTuning
from ttempc.estimation.noise import SensorNoise
from ttempc.guidance.controllers import CONTROLLERS, ESTIMATORS, controller_options, speed_tube
from ttempc.reference.corridor import SpeedTube
from ttempc.sensors import OTHERS, ROW_OF
from ttempc.tube.reference_tube import TubeDesign
from ttempc.vehicle import Vehicle

from ...testbed.configuration.config_io import (
    STRICT,
    DurationS,
    Fraction,
    NameOrFile,
    NotNegative,
    Positive,
)
from ...testbed.sensing.receivers import Place, receiver
from ...testbed.sensing.sensor_specification import SensorSpecification
from ...testbed.terminal import one_line
from ..errors import InvalidController, InvalidScenario
from .tube_file import read_tube
from .vehicle import ModelVehicleSettings, ParameterMismatch

OptionValue = bool | int | float | str | list[float] | None

TRUTH: Final = "truth"
"""Name of the estimator that returns the true state."""
_DEFAULT_TUBE: Final = "grass"
# Without measurement noise the covariance of the innovation would be singular.
_MIN_SD: Final = 1e-3  # [m], [rad], [m/s]
_MIN_SHARE: Final = 1e-2
_MIN_YAW_RATE_DEGPS: Final = 1e-3

AssumedSd = Annotated[float, Field(ge=_MIN_SD, le=1e6)]


@dataclass(frozen=True, config=STRICT)
class NoiseSettings:
    """Standard deviations that the estimator assumes; absent: those of `assumed`.

    Errors are taken for white but for the slow part of GNSS and the bias of a gyro, GNSS samples
    for those of the axle point unless the height of the antenna is given.
    """

    assumed: Literal["sensors", "paper"] = "sensors"
    """Origin of the absent keys: the table `[sensors]`, or the paper's sensors."""
    gnss_sd_m: AssumedSd | None = None
    """Position of both receivers, each axis."""
    angle_sd_deg: AssumedSd | None = None
    """Both steering angles and the hitch angle."""
    angle_offset_sd_deg: NotNegative | None = None
    """Offset of the sensors of the trailer's steering angle and of the hitch angle; 0: none."""
    encoder_sd_mps: AssumedSd | None = None
    """Speed of the encoder."""
    gnss_white_share: Annotated[float, Field(gt=0, le=1)] | None = None
    """White share of the variance of a position; the rest is correlated over time."""
    gnss_correlation_time_s: DurationS | None = None
    """Correlation time of that rest."""
    gnss_correlation_m: NotNegative | None = None
    """Distance over which it fades as well; 0: by time alone."""
    gnss_shared: Fraction | None = None
    """Share of the correlated variance that both receivers have in common."""
    gnss_float_sd_m: NotNegative | None = None
    """Float solutions, as white noise; 0: like any other."""
    yaw_rate_sd_degps: NotNegative | None = None
    """Yaw rate of both IMUs, where there are any; 0: the estimator does not use it."""
    yaw_rate_bias_sd_degps: Positive | None = None
    """Bias of this yaw rate at the start."""
    antenna_height_t_m: NotNegative = 0.0
    """Antenna of the tractor above the axle point; raw positions are corrected with the IMU."""
    antenna_height_i_m: NotNegative = 0.0
    """Antenna of the trailer above the axle point; raw positions are corrected with the IMU."""

    def filled(self, sensors: SensorSpecification) -> NoiseSettings:
        """Return the table with the absent keys filled in, each at least 0.001 in its SI unit."""
        return replace(self, **self._values(sensors))

    def sensor_noise(self, sensors: SensorSpecification) -> SensorNoise:
        """Return the noise that the estimator assumes; the sensors give the absent keys."""
        values = self._values(sensors)
        angle = math.radians(values["angle_sd_deg"])
        return SensorNoise(
            gnss=values["gnss_sd_m"],
            angle_offset=math.radians(values["angle_offset_sd_deg"]),
            steering=angle,
            hitch=angle,
            encoder=values["encoder_sd_mps"],
            gnss_white_share=values["gnss_white_share"],
            gnss_correlation_s=values["gnss_correlation_time_s"],
            gnss_correlation_m=values["gnss_correlation_m"],
            gnss_shared=values["gnss_shared"],
            gnss_float=values["gnss_float_sd_m"],
            yaw_rate=math.radians(values["yaw_rate_sd_degps"]),
            yaw_rate_bias=math.radians(values["yaw_rate_bias_sd_degps"]),
            antenna_height_t=self.antenna_height_t_m,
            antenna_height_i=self.antenna_height_i_m,
            attitude=max(math.radians(sensors.imu.angle_sd_deg), _MIN_SD),
            attitude_bias=max(math.radians(sensors.imu.angle_bias_sd_deg), _MIN_SD),
            velocity_wander=max(sensors.gnss_velocity_wander_mps, _MIN_SD),
            others=tuple(
                (sensor, max(plain.sd, _MIN_SD))
                for sensor, plain in sensors.plain_sensors.items()
                if ROW_OF[sensor].noise == OTHERS
            ),
        )

    def mismatch(self, sensors: SensorSpecification) -> tuple[ParameterMismatch, ...]:
        """Return the values that differ from those that the sensors' specification gives."""
        assumed = self._values(sensors)
        return tuple(
            ParameterMismatch(f"controller.noise.{key}", true, assumed[key])
            for key, true in _of_sensors(sensors).items()
            if assumed[key] != true
        )

    def _values(self, sensors: SensorSpecification) -> dict[str, float]:
        values = _of_sensors(sensors if self.assumed == "sensors" else SensorSpecification())
        given = {key: getattr(self, key) for key in values}
        return values | {key: value for key, value in given.items() if value is not None}


def _of_sensors(sensors: SensorSpecification) -> dict[str, float]:
    correlated = sensors.gnss_error == "correlated"
    return {
        "gnss_sd_m": max(sensors.gnss_sd_m, _MIN_SD),
        "angle_sd_deg": max(sensors.angle_sd_deg, math.degrees(_MIN_SD)),
        "angle_offset_sd_deg": sensors.angle_offset_sd_deg,
        "encoder_sd_mps": max(sensors.encoder_sd_mps, _MIN_SD),
        "gnss_white_share": max(sensors.gnss_white_share, _MIN_SHARE) if correlated else 1.0,
        "gnss_correlation_time_s": sensors.gnss_correlation_time_s,
        "gnss_correlation_m": 0.0,
        "gnss_shared": 0.0,
        "gnss_float_sd_m": 0.0,
        **(_of_receiver(place, sensors.gnss_rate_hz) if (place := sensors.place) else {}),
        "yaw_rate_sd_degps": max(sensors.imu.yaw_rate_sd_degps, _MIN_YAW_RATE_DEGPS),
        "yaw_rate_bias_sd_degps": max(sensors.imu.yaw_rate_bias_sd_degps, _MIN_YAW_RATE_DEGPS),
    }


def _of_receiver(place: Place, rate_hz: float) -> dict[str, float]:
    """Return a receiver's errors as first-order processes of the same variance and density.

    The integral of (1 + u) exp(-u) is 2. The offset of a float solution becomes white noise of its
    density at low frequency, at 1 m/s.
    """
    of = receiver(place)
    slow = of.sd**2 - of.white_sd**2
    return {
        "gnss_sd_m": of.sd,
        "gnss_white_share": max(of.white_sd**2 / of.sd**2, _MIN_SHARE),
        "gnss_correlation_time_s": 2.0 * of.time,
        "gnss_correlation_m": 2.0 * of.length,
        "gnss_shared": of.shared_sd**2 / slow,
        "gnss_float_sd_m": of.float_sd * math.sqrt(2.0 * of.float_length * rate_hz)
        if of.lost_per_s > 0.0
        else 0.0,
    }


@dataclass(frozen=True, config=STRICT)
class ControllerSettings:
    """The controller, its options, and the estimator."""

    name: str = "ttempc"
    """Name in ttempc/guidance/controllers.py, or "package.module:factory" of a user's own."""
    estimator: str = "ekf"
    """Name in ttempc/guidance/controllers.py, "truth", or "package.module:factory"."""
    tube: NameOrFile | None = None
    """Name of a shipped tube, or path of a file relative to the scenario; absent: that of grass,
    which `ttempc` leaves out where its vehicle differs."""
    options: dict[str, OptionValue] = Field(default_factory=dict)
    """Options of the controller, such as `horizon`; keyword arguments of a user's factory."""
    vehicle: ModelVehicleSettings = ModelVehicleSettings()
    """Parameters of the model of controller and estimator."""
    noise: NoiseSettings = NoiseSettings()
    """Noise of the sensors that the estimator assumes."""
    learn: bool = True
    """Whether parameters of the model are learnt while driving, see docs/appendix/adaptation.md."""
    learn_field: bool = False
    """Whether disturbances are learnt by place, for later passes over the same line."""
    foresee: bool | None = None
    """Whether the trailer's side slip is foretold from what its tractor has met at a place; absent:
    for `ttempc` and `ttempc-nominal`."""
    detect: bool | list[str] = True
    """Whether the built-in detectors of faults run; or the names of those that do, of ttempc's
    detectors/table.py, or, each after a minus sign, of those that do not. Under `serve` all run."""
    compensate: bool = True
    """Whether dead times of the valves are compensated, given or learnt."""

    def __post_init__(self) -> None:
        try:
            chosen(self.detect)
        except InvalidTuning as error:
            raise InvalidScenario(f"controller.{error}") from None
        if ":" not in self.estimator and self.estimator not in (*ESTIMATORS, TRUTH):
            allowed = ", ".join(sorted((*ESTIMATORS, TRUTH)))
            raise InvalidScenario(
                f"controller.estimator: got {self.estimator!r}, allowed are {allowed}, or "
                "package.module:factory"
            )

    @property
    def tube_name(self) -> str:
        """Name or path of the tube, the default where none is given."""
        return self.tube or _DEFAULT_TUBE

    def design(self, vehicle: Vehicle, period_s: float) -> TubeDesign | None:
        """Return the design of the tube that the controller needs or uses, None without one."""
        entry = CONTROLLERS.get(self.name)
        if entry is None or entry.tube is None:
            return None
        design = read_tube(self.tube_name).design()
        if entry.tube == "optional" and self.tube is None and design.differing(vehicle, period_s):
            return None
        design.require(vehicle, period_s)
        return design

    def notes(self, vehicle: Vehicle, period_s: float) -> tuple[str, ...]:
        """Return what a user has to know of the controller's tube; nothing where it has one."""
        entry = CONTROLLERS.get(self.name)
        if entry is None or entry.tube is None or self.design(vehicle, period_s):
            return ()
        options = controller_options(self.name, self.options)
        if not options["tube"]:
            return ()
        return (
            f"inputs of {self.name} are not tightened: the tube of {_DEFAULT_TUBE} is for another "
            "vehicle or control period, and controller.tube names no other",
        )

    def speed_tube(self) -> SpeedTube | None:
        """Return the half widths that the controller keeps over speed, None where it has none."""
        return speed_tube(self.name, self.options) if self.name in CONTROLLERS else None

    def of_user(self, name: str, options: Mapping[str, object]) -> ControllerSettings:
        """Return the same with a user's factory and its options.

        Raises:
            InvalidController: a scenario cannot have the value of an option.
        """
        values = {key: _plain(value) for key, value in options.items()}
        try:
            return replace(self, name=name, options=values)
        except ValidationError as error:
            key = error.errors()[0]["loc"][1]
            raise InvalidController(
                f"controller {name!r}: options.{key}: got {one_line(repr(values[str(key)]))}, "
                "must be a number, text, true, false, or a list of numbers"
            ) from None

    def with_defaults(self) -> ControllerSettings:
        """Return the same with every option of a shipped controller filled in."""
        if self.name not in CONTROLLERS:
            return self
        options = controller_options(self.name, self.options)
        return replace(self, options={key: _plain(value) for key, value in options.items()})


def _plain(value: object) -> OptionValue:
    """Return a value as TOML has it: tuples and arrays are lists."""
    if isinstance(value, tuple):
        value = list(value)
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    return value  # pyright: ignore[reportReturnType] - checked where it is stored


@dataclass(frozen=True, config=STRICT)
class StageSettings:
    """A stage in the list of `testbed/simulation/loop.py`, such as a fault or a disturbance.

    factory(generator, **options) returns a function of the simulation set-up and the tick.
    """

    make: str
    """Factory of the stage, "package.module:factory"."""
    after: Literal["prepare", "sense", "estimate", "control", "advance"]
    """Stage after which it runs: `sense` to change samples, `control` to change commands."""
    options: dict[str, OptionValue] = Field(default_factory=dict)
    """Keyword arguments of the factory."""
