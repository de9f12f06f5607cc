"""Vehicle file with the lengths that fit the samples of a log: `ttempc fit vehicle`."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from ttempc.estimation.noise import ProcessNoise
from ttempc.learning.learner import LENGTHS, ParameterChange
from ttempc.learning.lengths import KNOWN_SD, fit_lengths

from ...testbed.configuration.config_io import validated
from ...testbed.errors import InvalidPlant
from ...testbed.vehicle.vehicle import PlantVehicle
from ..errors import InvalidReplay
from ..run.assembly import model_vehicle
from ..scenario.vehicle import LENGTH_KEYS, edited_file
from .replay import read_run, ticks

_LEAST_S: Final = 30.0  # of driving; assumed


@dataclass(frozen=True, slots=True)
class Calibration:
    """Lengths of a vehicle before and after a fit to a log."""

    changes: tuple[ParameterChange, ...]  # of all lengths, in the order of `LENGTHS`
    file: str  # text of a vehicle file

    def format(self) -> list[str]:
        """Return a line for each length, by its key in `[controller.vehicle]` of a scenario."""
        return [
            f"{LENGTH_KEYS[item.name]:<16}{item.before:8.3f} -> {item.after:6.3f} +- {item.sd:.3f}"
            for item in self.changes
        ]


def calibrate(log: Path) -> Calibration:
    """Return the lengths that fit the samples and commands of a log, see `fit_lengths`.

    Raises:
        LogError: no such file, not a log of this project, or of another version of it.
        InvalidReplay: the log is too short, has no sample of a sensor or no curves, or the lengths
            do not fit together with the rest of the vehicle.
    """
    record, scenario = read_run(log)
    vehicle = model_vehicle(scenario.mission(), scenario, scenario.vehicles())
    window = list(ticks(record))
    driven_s = window[-1].time_s - window[0].time_s
    if driven_s < _LEAST_S:
        raise InvalidReplay(f"{log}: holds {driven_s:.0f} s of driving, must be {_LEAST_S:.0f} s")
    noise = scenario.controller.noise.sensor_noise(scenario.sensors)
    fit = fit_lengths(window, vehicle, vehicle, noise, ProcessNoise.of(vehicle))
    if fit is None:
        raise InvalidReplay(
            f"{log}: no lengths fit; samples of both receivers, both steering angles, hitch angle "
            "and encoder are needed"
        )
    sd = np.sqrt(np.diag(fit.covariance))
    known = sd[0] / vehicle.wheelbase
    if known > KNOWN_SD:
        raise InvalidReplay(
            f"{log}: has too few curves: the wheelbase is known to {100 * known:.0f} % only, must "
            f"be {100 * KNOWN_SD:.0f} %"
        )
    after = dict(zip(LENGTHS, fit.lengths.tolist(), strict=False))
    changes = tuple(
        ParameterChange(name, getattr(vehicle, name), after[name], deviation)
        for name, deviation in zip(LENGTHS, sd.tolist(), strict=False)
    )
    values = {LENGTH_KEYS[name]: value for name, value in after.items()}
    text = edited_file(scenario.plant.vehicle.file_text(), values, f"fitted to {log}")
    try:
        validated(PlantVehicle, tomllib.loads(text), InvalidPlant)
    except InvalidPlant as error:
        raise InvalidReplay(f"{log}: the lengths that fit make no vehicle: {error}") from None
    return Calibration(changes, text)
