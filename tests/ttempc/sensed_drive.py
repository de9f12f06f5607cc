"""Closed loop of estimator and controller, with the filter's own model as the plant."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from tests.reference.estimation.augmented_state import density, predicted_measurement, slips
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.estimation.noise import ProcessNoise, SensorNoise
from ttempc.guidance.controllers import make_controller
from ttempc.jit.rows import WIDTH
from ttempc.models.augmented_state import (
    SIZE,
    STATES,
    AugmentedState,
    advance_augmented_state,
    vehicle_parameters,
)
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.sensors import STARTING_SENSORS
from ttempc.types import Command, Estimate, Estimator, FloatArray, Measurement, Sensor, State
from ttempc.vehicle import Vehicle

PERIOD_S = 0.2
SUBSTEPS = 20  # of 10 ms
FAST_EVERY = 4  # substeps between samples of the 25 Hz sensors
GNSS = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
FAST = tuple(sensor for sensor in STARTING_SENSORS if sensor not in GNSS)
VEHICLE = Vehicle()
REFERENCE = Reference(figure_eight(), VEHICLE, ConstantSpeed(1.0))
SENSOR_NOISE = SensorNoise()
PARAMETERS = vehicle_parameters(VEHICLE, True)

Corruption = Callable[[list[Measurement]], list[Measurement]]


@dataclass
class SensedDrive:
    """A drive along the figure eight; true states and estimates tick by tick."""

    seed: int
    process_noise: ProcessNoise = field(default_factory=ProcessNoise)
    sensor_scale: float = 1.0  # standard deviation of the sensors over that of the filter's model
    corrupt: Corruption | None = None  # applied to the samples of a tick before the filter
    estimator: Estimator = field(default_factory=lambda: ExtendedKalmanFilter(VEHICLE))
    states: list[FloatArray] = field(default_factory=list)
    estimates: list[Estimate] = field(default_factory=list)
    received: list[tuple[list[Measurement], Command | None]] = field(default_factory=list)

    def run(self, ticks: int) -> SensedDrive:
        """Drive for `ticks` control periods."""
        self._generator = np.random.default_rng(self.seed)
        bumps = np.random.default_rng([self.seed, 1]).standard_normal(ticks)
        controller = make_controller("paper-subtracted", VEHICLE, REFERENCE, PERIOD_S)
        augmented, command = np.zeros(SIZE), None
        augmented[:STATES] = REFERENCE.at(0.0).state
        self._valves = augmented[AugmentedState.DELTA_T : AugmentedState.WHEEL_SPEED].copy()
        measurements = self._sample(augmented, 0.0, STARTING_SENSORS)
        for k in range(ticks):
            if self.corrupt:
                measurements = self.corrupt(measurements)
            estimate = self.estimator.update(k * PERIOD_S, measurements, command)
            state = augmented[:STATES].copy()
            state[State.V] *= 1.0 - slips(augmented).wheel
            state[State.V] *= 1.0 + self._slip_on_bumps() * bumps[k]
            self.states.append(state)
            self.estimates.append(estimate)
            self.received.append((measurements, command))
            command = controller.step(estimate, k).command
            augmented, measurements = self._advance(augmented, command, k)
        return self

    def _slip_on_bumps(self) -> float:
        """Return the standard deviation of the wheel slip on bumps.

        It has a correlation length. Where it is white in the model, as in the steps of this plant,
        its variance in a metre is that of the slip times twice this length.
        """
        noise = self.process_noise
        return noise.slip_forward * float(np.sqrt(0.5 * noise.roughness / noise.bump_m))

    def errors(self) -> FloatArray:
        """Return true less estimated states, (N, 7)."""
        return np.array(self.states) - np.array([e.state for e in self.estimates])

    def normalised_innovations(self, sensor: Sensor) -> FloatArray:
        """Return the normalised squared innovations of `sensor`."""
        innovations = (i for estimate in self.estimates for i in estimate.innovations)
        return np.array([i.normalised_squared for i in innovations if i.sensor is sensor])

    def _advance(
        self, augmented: FloatArray, command: Command, k: int
    ) -> tuple[FloatArray, list[Measurement]]:
        step_s = PERIOD_S / SUBSTEPS
        noise = self.process_noise
        sent = command.as_array()
        fading = noise.fading(SENSOR_NOISE).ravel()
        measurements = []
        augmented = augmented.copy()
        unused = np.empty((SIZE, WIDTH))
        for j in range(1, SUBSTEPS + 1):
            added = density(noise, augmented, noise.scales, VEHICLE, SENSOR_NOISE)
            advance_augmented_state(
                augmented, self._valves, sent, PARAMETERS, fading, step_s, unused
            )
            entries = int(AugmentedState.OFFSET_HITCH)  # the drive has neither offsets nor gyros
            added = added[:entries, :entries]
            root = np.linalg.cholesky(added * step_s + 1e-24 * np.eye(entries))
            augmented[:entries] += root @ self._generator.standard_normal(entries)
            sensors = FAST if j % FAST_EVERY == 0 else ()
            sensors = (*sensors, *GNSS) if j == SUBSTEPS else sensors
            measurements += self._sample(augmented, k * PERIOD_S + j * step_s, sensors)
        return augmented, measurements

    def _sample(
        self, augmented: FloatArray, time_s: float, sensors: tuple[Sensor, ...]
    ) -> list[Measurement]:
        samples = []
        for sensor in sensors:
            value, _ = predicted_measurement(sensor, augmented, VEHICLE, True)
            sd = self.sensor_scale * SENSOR_NOISE.of(sensor)
            value = value + sd * self._generator.standard_normal(len(value))
            samples.append(Measurement(time_s, sensor, tuple(value.tolist())))
        return samples
