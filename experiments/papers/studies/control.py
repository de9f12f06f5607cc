"""Recovery from an offset, learning of wrong lengths, and the order of controllers.

Three questions on controllers that take more than laps of scenarios as they ship.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pandas as pd
from scipy.stats import qmc

from ttempc.types import FloatArray, State

from ....testbed.recording.channels import CONTROL
from ....testbed.recording.record import Recorder
from ....testbed.simulation.loop import drive
from ....testbed.vehicle.vehicle import read_vehicle
from ....testbed.wheels.soil_law import SoilLaw
from ...results.statistics import proportion
from ...results.tracking_errors import START_UP_S, tracking_errors
from ...run.assembly import assemble, check
from ...run.simulate import simulate
from ...scenario.scenario import load
from ...scenario.vehicle import LENGTH_KEYS
from ...seeds import FIRST, report_seeds
from ..cells import POINTS, grouped, groups, label, numbers, slash
from ..runner import Runner
from ..study import Case, Row, Study
from ..tables import markdown

NEAR_M: Final = 0.10
OFFSETS: Final = ((1.0, 20.0), (-1.0, -20.0), (1.0, -20.0))  # [m] to the left, [deg] turned left


def recover(case: Case, ticks: int = 150) -> Row:
    """Drive a straight line from a lateral offset [m] and a yaw offset of both bodies [deg].

    Args:
        case: its label `offset` is the pair of both, to the left.
        ticks: control periods to drive.

    Returns:
        `travel_m` until both points stay within `NEAR_M` of the path, infinite if they do not;
        `overshoot_m` of the trailer to the other side; `excess`, the largest amount by which a
        command left amplitude or rate, 0 where none did.
    """
    path = f'path={{kind="straight",length_m={ticks / 5.0}}}'
    assembly = assemble(load(case.scenario, (path, *case.overrides))[1], case.seed)
    recorder, (lateral_m, yaw_deg) = Recorder(), case["offset"]
    setup = assembly.setup(recorder)
    start = assembly.reference.at(0.0).state.tolist()
    (x, y, yaw), speed = start[:3], start[State.V]
    x, y = x - lateral_m * math.sin(yaw), y + lateral_m * math.cos(yaw)
    assembly.plant.reset(x, y, yaw + math.radians(yaw_deg), speed)
    drive(setup, ticks)
    record = recorder.record()

    errors = tracking_errors(record)
    beside = np.stack([errors.tractor.cross_m, errors.trailer.cross_m])  # (2, n)
    outside = np.flatnonzero(np.abs(beside).max(axis=0) > NEAR_M)
    last = int(outside[-1]) + 1 if len(outside) else 0
    arrived = last < len(errors.time_s)
    sent, vehicle = record[CONTROL], assembly.vehicle
    commands = np.stack([sent[f"{name}_command"] for name in ("delta_t_rad", "delta_i_rad", "hp")])
    most = setup.control_steps * assembly.plant.timestep_s * vehicle.input_rate[:, None]
    low, high = vehicle.input_min[:, None] - commands, commands - vehicle.input_max[:, None]
    beyond = max((np.abs(np.diff(commands)) - most).max(), low.max(), high.max())
    return {
        "travel_m": float(speed * errors.time_s[last]) if arrived else math.inf,
        "overshoot_m": float(max(0.0, (-math.copysign(1.0, lateral_m) * beside[1]).max())),
        "excess": float(max(0.0, beyond)),
    }


def _offset(runs: pd.DataFrame) -> str:
    lateral, yaw = runs["offset"].iloc[0]
    return f"{lateral:+.0f} m, {yaw:+.0f} deg"


FACTORS: Final = (  # of wheelbase, hitch offset, drawbar and trailer
    (1.0, 1.0, 1.0, 1.0),
    (1.24, 1.09, 1.2, 0.92),
    (0.7, 0.7, 0.7, 0.7),
    (1.3, 1.3, 1.3, 1.3),
    (1.3, 0.7, 1.3, 0.7),
)
_WRONG: Final = ("controller.vehicle.wheelbase_m=1.74", "controller.vehicle.drawbar_m=0.96")


def _lengths(factors: tuple[float, ...]) -> tuple[str, ...]:
    """Return the changes that give the model the true lengths of `grass` times factors."""
    lengths = load("grass")[1].vehicles().plant_lengths
    return tuple(
        f"controller.vehicle.{LENGTH_KEYS[name]}={length * factor}"
        for (name, length), factor in zip(lengths.items(), factors, strict=True)
    )


def errors_by_lap(case: Case) -> Row:
    """Return the mean errors of tractor and trailer on straights, then on curves, of two laps [m].

    The first 8 s are left out. NaN where the vehicle did not arrive.
    """
    scenario = load(case.scenario, case.overrides)[1]
    errors = tracking_errors(simulate(case.scenario, scenario, case.seed)[1])
    lap = np.floor(errors.time_s / (0.5 * check(scenario) * scenario.control.period_s))
    means = {}
    for n, name in enumerate(("first", "second")):
        places = [
            point.euclidean_m[(lap == n) & (errors.time_s >= START_UP_S) & where]
            for where in (~errors.curved, errors.curved)
            for point in (errors.tractor, errors.trailer)
        ]
        means[name] = [float(place.mean()) if len(place) else math.nan for place in places]
    return means


RANKED: Final = ("ttempc", "pid", "lqr", "paper")  # the first is compared with each other one
DRAWS: Final = 12
SPREAD: Final = 0.5  # of the factor about 1
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
"""Values that `mjcf/vehicles/kayacan2016.toml` marks as assumed.

Not varied: the distance from axle to hitch, which the geometric model is told, and the stops of the
steering, below which the vehicle cannot drive the path.
"""
LAW: Final = (
    "relaxation_long_m",
    "relaxation_lat_m",
    "damping_long_s",
    "damping_lat_s",
    "side_most",
    "side_stiffness_most_per_rad",
)
"""Values of the wheel law without a published source."""
TYRES: Final = ("bias", "radial")


def drawn_plant(shares: FloatArray) -> tuple[str, ...]:
    """Return the changes of one drawn plant.

    The model keeps its values but for the steering lags, which an identification of the machine
    would give.

    Args:
        shares: (len(VEHICLE) + len(LAW) + 1,) uniform numbers of 0 to 1: a factor of 0.5 to 1.5 for
            each value, and the kind of tyre.
    """
    scale = 1.0 - SPREAD + 2.0 * SPREAD * shares  # (n,)
    vehicle, law = read_vehicle(), SoilLaw()
    lines: list[str] = []
    for key, factor in zip(VEHICLE, scale, strict=False):
        part, name = key.split(".")
        value = float(factor * getattr(getattr(vehicle, part), name))
        lines.append(f"plant.vehicle.parts.{key}={value!r}")
        if name == "lag_s":
            lines.append(f"controller.vehicle.{part.split('_')[0]}_lag_s={value!r}")
    for name, factor in zip(LAW, scale[len(VEHICLE) :], strict=False):
        lines.append(f"plant.wheel_law.{name}={float(factor * getattr(law, name))!r}")
    tyre = TYRES[min(int(shares[-1] * len(TYRES)), len(TYRES) - 1)]
    return (*lines, f'plant.wheel_law.tyre="{tyre}"')


def ranking(runner: Runner) -> str:
    """Return whether the order of the controllers survives changes of all assumed values.

    Drawn plants and the plant as it ships have the same ground and noise, by draw.
    """
    draws = len(runner.report_seeds(DRAWS))
    sample = qmc.LatinHypercube(len(VEHICLE) + len(LAW) + 1, rng=1).random(draws)
    runs = runner.frame(
        [
            Case(
                field,
                FIRST + draw,
                ("path.laps=1", *changes, f'controller.name="{name}"'),
                {"driver": name, "plant": plant},
            )
            for field in ("grass", "patchy", "wet-slope")
            for name in RANKED
            for plant in ("ships", "drawn")
            for draw, shares in enumerate(sample)
            for changes in [drawn_plant(shares) if plant == "drawn" else ()]
        ]
    )
    lines = []
    for field in groups(runs, ["scenario"]):
        errors = {
            (one["plant"].iloc[0], one["driver"].iloc[0]): errors_cm(one)
            for one in groups(field, ["driver", "plant"])
        }
        for rival in RANKED[1:]:
            cells = [f"`{field['scenario'].iloc[0]}`", f"`{rival}`"]
            for plant in ("ships", "drawn"):
                cells += ahead(errors[plant, RANKED[0]], errors[plant, rival])
            lines.append(cells)
    heads = [
        head
        for plant in ("as it ships", "drawn")
        for head in (f"{plant}: rival - `ttempc` [cm]", "`ttempc` ahead")
    ]
    return markdown(["field", "rival", *heads], lines)


def errors_cm(runs: pd.DataFrame) -> FloatArray:
    """Return the mean errors of both points [cm], (n,); infinite for lost runs."""
    errors = 50.0 * numbers(runs, *POINTS).sum(axis=1)
    kept = (runs["status"] == "completed").to_numpy() & np.isfinite(errors)
    return np.where(kept, errors, np.inf)


def ahead(own: FloatArray, other: FloatArray) -> list[str]:
    """Return median and range of other - own, and how often own is smaller, from errors (n,)."""
    less = proportion(int(np.sum(own < other)), len(own))
    both = np.isfinite(own) & np.isfinite(other)
    low, median, high = np.quantile(other[both] - own[both], (0.05, 0.5, 0.95))
    share = f"{less.count}/{less.total} ({100 * less.low:.0f} to {100 * less.high:.0f} %)"
    return [f"{median:+.2f} ({low:+.2f} to {high:+.2f})", share]


STUDIES: Final = (
    Study(
        name="recovery",
        scenarios=("grass", "wet-slope"),
        overrides=(),
        axes={"offset": OFFSETS},
        seeds=report_seeds(2),
        drive=recover,
        table=lambda runs: grouped(
            runs,
            ["scenario", "offset", "seed"],
            {
                "ttempc": label("scenario", "`{}`"),
                "offset": _offset,
                "seed": label("seed"),
                "travel until within 10 cm": label("travel_m", "{:.1f} m"),
                "trailer overshoot": lambda own: f"{100 * own['overshoot_m'].iloc[0]:.0f} cm",
                "limits": lambda own: "kept" if own["excess"].iloc[0] < 1e-9 else "left",
            },
        ),
        checks=(("grass", "ttempc"), ("wet-slope", "ttempc")),
        minutes=0.3,
    ),
    Study(
        name="learning",
        overrides=("path.laps=2", 'controller.name="ttempc"'),
        axes={
            "factors": {factors: _lengths(factors) for factors in FACTORS},
            "learnt": {
                answer: (f"controller.learn={value}",)
                for answer, value in (("no", "false"), ("yes", "true"))
            },
        },
        seeds=report_seeds(2),
        drive=errors_by_lap,
        table=lambda runs: grouped(
            runs,
            ["factors", "learnt"],
            {
                "model lengths over true ones, ttempc": lambda own: ", ".join(
                    f"{factor:g}" for factor in own["factors"].iloc[0]
                ),
                "learnt": label("learnt"),
                "first lap": lambda own: slash(np.mean([*own["first"]], axis=0), ".2f"),
                "second lap": lambda own: slash(np.mean([*own["second"]], axis=0), ".2f"),
            },
        ),
        checks=(("grass", "ttempc"), ("grass", "ttempc", *_WRONG)),
        minutes=4.0,
    ),
    Study(
        name="ranking",
        seeds=report_seeds(DRAWS),
        make=ranking,
        checks=(
            *((name, "ttempc") for name in ("grass", "patchy", "wet-slope")),
            *(("grass", name) for name in RANKED[1:]),
        ),
        minutes=10.0,
    ),
)
