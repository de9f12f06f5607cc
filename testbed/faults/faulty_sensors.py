"""Sensors with faults: the samples of a sensor suite on their way to the estimator."""

from __future__ import annotations

from collections.abc import Sequence

from ttempc.types import Measurement, Sensor

from ..randomness import generator
from ..sensing.sensor_specification import SensorSpecification
from ..sensing.sensors import Sensors
from ..truth import Truth
from .fault import Window
from .sensor_faults import SampleFilter, SensorFault


class FaultySensors:
    """Passes on the samples of other sensors, changed by the faults in their order.

    A fault changes the samples that are taken while it lasts, whenever they arrive.

    Args:
        sensors: without faults.
        faults: with their numbers in the scenario and their windows.
        timestep: physics step [s].
        seed: of the run.
    """

    def __init__(
        self,
        sensors: Sensors,
        faults: Sequence[tuple[int, SensorFault, Window]],
        timestep: float,
        seed: int,
    ) -> None:
        self._sensors, self._timestep = sensors, timestep
        self._in_transit: list[tuple[int, Measurement]] = []  # physics step of delivery, sample
        self._chain: list[tuple[Window, dict[Sensor, SampleFilter]]] = []
        for number, fault, window in faults:
            filters = {
                sensor: fault.filter(
                    window,
                    sensors.specification,
                    generator(seed, f"fault {number} {fault.kind} {sensor}"),
                )
                for sensor in fault.sensors
            }
            self._chain.append((window, filters))

    @property
    def specification(self) -> SensorSpecification:
        """Specification of the sensors without faults."""
        return self._sensors.specification

    @property
    def every(self) -> int:
        """Physics steps between two moments at which any sensor samples or delivers."""
        return self._sensors.every

    def sample(self, truth: Truth, step: int) -> list[Measurement]:
        """Return the samples that arrive at physics step `step`."""
        for sample in self._sensors.sample(truth, step):
            for delay_s, changed in self._changed(sample):
                self._in_transit.append((step + round(delay_s / self._timestep), changed))
        arrived = [sample for due, sample in self._in_transit if due <= step]
        self._in_transit = [item for item in self._in_transit if item[0] > step]
        return arrived

    def _changed(self, sample: Measurement) -> list[tuple[float, Measurement]]:
        """Return what arrives in the place of a sample, each with its further delay [s]."""
        items = [(0.0, sample)]
        for window, filters in self._chain:
            if not window.holds(sample.time_s):
                continue
            after = []
            for delay_s, item in items:
                change = filters.get(item.sensor)
                changed = change(item) if change else [(0.0, item)]
                after += [(delay_s + further_s, one) for further_s, one in changed]
            items = after
        return items
