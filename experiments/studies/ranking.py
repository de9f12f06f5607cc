"""Order of the controllers under changes of all assumed values of the plant.

    python -m experiments.studies.ranking [DRAWS]          (default: 12)

The vehicle file and the wheel law hold values without a published source. Every draw multiplies
each of them by its own factor of 0.5 to 1.5 (Latin hypercube) and takes the law of bias-ply or of
radial tyres. The controllers drive one lap of three fields on the drawn plant and, with the same
ground and noise, on the plant as it ships. Their model keeps its values, except for the steering
lags, which an identification of the machine would give.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np
from scipy.stats import qmc

from ttempc.types import FloatArray

from ...testbed.vehicle.vehicle import read_vehicle
from ...testbed.wheels.soil_law import SoilLaw
from ..results.statistics import proportion
from ..results.summary import Summary
from ..seeds import FIRST
from .batch import StudyRun, simulate_runs

FIELDS: Final = ("grass", "patchy", "wet-slope")
CONTROLLERS: Final = ("ttempc", "pid", "lqr", "paper")  # the first is compared with each other one
SPREAD: Final = 0.5  # of the factor about 1
FIRST_SEED: Final = FIRST

# Values that `mjcf/vehicles/kayacan2016.toml` marks as assumed, by table and key. Not varied: the
# distance from axle to hitch, which the geometric model is told, and the stops of the steering,
# below which the vehicle cannot drive the path.
VEHICLE: Final = (
    *(f"tractor.{key}" for key in ("mass_kg", "centre_forward_m", "centre_height_m")),
    *(f"trailer.{key}" for key in ("mass_kg", "centre_forward_m", "centre_height_m")),
    "drawbar.mass_kg",
    *(
        f"{wheel}.{key}"
        for wheel in ("front_wheel", "rear_wheel", "trailer_wheel")
        for key in ("relative_deflection", "rated_load_n", "damping_spm", "mass_kg")
    ),
    "front_steering.lag_s",
    "trailer_steering.lag_s",
)
# Values of the wheel law without a published source, and the kinds of tyre.
LAW: Final = (
    "relaxation_long_m",
    "relaxation_lat_m",
    "damping_long_s",
    "damping_lat_s",
    "side_most",
    "side_stiffness_most_per_rad",
)
TYRES: Final = ("bias", "radial")


def changes(factors: FloatArray) -> tuple[str, ...]:
    """Return the overrides of one draw.

    Args:
        factors: (len(VEHICLE) + len(LAW) + 1,) uniform numbers of 0 to 1: a factor for each value,
            and the kind of tyre.
    """
    scale = 1.0 - SPREAD + 2.0 * SPREAD * factors  # (n,)
    vehicle, law = read_vehicle(), SoilLaw()
    lines: list[str] = []
    for key, factor in zip(VEHICLE, scale, strict=False):
        table, name = key.split(".")
        value = float(factor * getattr(getattr(vehicle, table), name))
        lines.append(f"plant.vehicle.parts.{key}={value!r}")
        if name == "lag_s":
            lines.append(f"controller.vehicle.{table.split('_')[0]}_lag_s={value!r}")
    for name, factor in zip(LAW, scale[len(VEHICLE) :], strict=False):
        lines.append(f"plant.wheel_law.{name}={float(factor * getattr(law, name))!r}")
    tyre = TYRES[min(int(factors[-1] * len(TYRES)), len(TYRES) - 1)]
    return (*lines, f'plant.wheel_law.tyre="{tyre}"')


def error_cm(summary: Summary) -> float:
    """Return the mean Euclidean error of tractor and trailer [cm]; infinite for a lost run."""
    points = summary.tracking.all.tractor, summary.tracking.all.trailer
    errors = [point.mean_euclidean_m for point in points]
    if summary.status != "completed" or None in errors:
        return float("inf")
    return 50.0 * sum(error for error in errors if error is not None)


def rows(
    field: str, shipped: dict[str, FloatArray], drawn: dict[str, FloatArray]
) -> Iterator[list[str]]:
    """Yield a row of the table for every rival.

    Args:
        field: name of the scenario.
        shipped: errors of every controller on the plant as it ships, (draws,) [cm].
        drawn: errors on the drawn plants, (draws,) [cm].
    """
    first, *rivals = CONTROLLERS
    for rival in rivals:
        cells = [f"`{field}`", f"`{rival}`"]
        for errors in (shipped, drawn):
            own, other = errors[first], errors[rival]
            ahead = proportion(int(np.sum(own < other)), len(own))
            both = np.isfinite(own) & np.isfinite(other)
            low, median, high = np.quantile(other[both] - own[both], (0.05, 0.5, 0.95))
            cells += [
                f"{median:+.2f} ({low:+.2f} to {high:+.2f})",
                f"{ahead.count}/{ahead.total} ({100 * ahead.low:.0f} to {100 * ahead.high:.0f} %)",
            ]
        yield cells


def table(
    draws: int = 12, fields: Sequence[str] = FIELDS, path: str = "path.laps=1"
) -> Iterator[str]:
    """Drive all draws and yield the lines of the Markdown table.

    Args:
        draws: number of drawn plants; draw i has the seed `FIRST_SEED` + i.
        fields: names of scenarios with the paper's vehicle.
        path: override of their path.
    """
    sample = qmc.LatinHypercube(len(VEHICLE) + len(LAW) + 1, rng=1).random(draws)  # (draws, n)
    plants = [changes(factors) for factors in sample]
    cases = [(field, controller) for field in fields for controller in CONTROLLERS]
    runs = [
        StudyRun(field, FIRST_SEED + draw, (*plant, f'controller.name="{controller}"', path))
        for field, controller in cases
        for draw, drawn in enumerate(plants)
        for plant in ((), drawn)
    ]
    errors = np.array([error_cm(summary) for summary in simulate_runs(runs)])
    by_case = dict(zip(cases, errors.reshape(len(cases), draws, 2), strict=True))
    yield (
        "| field | rival | as it ships: rival - `ttempc` [cm] | `ttempc` ahead "
        "| drawn: rival - `ttempc` [cm] | `ttempc` ahead |"
    )
    yield "|---" * 6 + "|"
    for field in fields:
        shipped, drawn = (
            {controller: by_case[field, controller][:, column] for controller in CONTROLLERS}
            for column in (0, 1)
        )
        for cells in rows(field, shipped, drawn):
            yield f"| {' | '.join(cells)} |"


def main(draws: int = 12) -> None:
    """Print the table."""
    for line in table(draws):
        print(line)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
