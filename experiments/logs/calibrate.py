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
_MOST_SD: Final = 2.0  # of the hitch, beside the best fit; assumed


@dataclass(frozen=True, slots=True)
class Calibration:
    """Lengths of a vehicle before and after a fit to a log."""

    changes: tuple[ParameterChange, ...]  # of all lengths, in the order of `LENGTHS`
    file: str  # text of a vehicle file
    moved_sd: float  # by which the hitch is behind that of the fit, see `calibrate`

    def format(self) -> list[str]:
        """Return a line for each length, by its key in `[controller.vehicle]` of a scenario."""
        lines = [
            f"{LENGTH_KEYS[item.name]:<16}{item.before:8.3f} -> {item.after:6.3f} +- {item.sd:.3f}"
            for item in self.changes
        ]
        if self.moved_sd > 0.0:
            lines.append(
                f"hitch {self.moved_sd:.1f} sd behind the best fit, which no vehicle can have"
            )
        return lines


def calibrate(log: Path) -> Calibration:
    """Return the lengths that fit the samples and commands of a log, see `fit_lengths`.

    Hitch offset and drawbar are hard to tell apart: the best fit may have the drawbar in the rear
    wheels where the true one clears them. Then the most likely lengths with a hitch farther behind
    count, up to 2 sd: theta + n P e / sd, with n the least that makes a vehicle and e the hitch.

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
    hitch = LENGTHS.index("hitch_offset")
    source, refused = scenario.plant.vehicle.file_text(), None
    for moved_sd in np.linspace(0.0, _MOST_SD, 21).tolist():
        lengths = fit.lengths + moved_sd * fit.covariance[:, hitch] / sd[hitch]
        after = dict(zip(LENGTHS, lengths.tolist(), strict=False))
        values = {LENGTH_KEYS[name]: value for name, value in after.items()}
        text = edited_file(source, values, f"fitted to {log}")
        try:
            validated(PlantVehicle, tomllib.loads(text), InvalidPlant)
        except InvalidPlant as error:
            refused = refused or error
            continue
        rows = zip(LENGTHS, sd.tolist(), strict=False)
        changes = tuple(
            ParameterChange(name, getattr(vehicle, name), after[name], own) for name, own in rows
        )
        return Calibration(changes, text, moved_sd)
    raise InvalidReplay(f"{log}: the lengths that fit make no vehicle: {refused}")
