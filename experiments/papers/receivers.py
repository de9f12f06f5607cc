"""Fits the error model of `testbed.sensing.receivers` to public records of real receivers.

    git clone --depth 1 https://github.com/taroz/MatRTKLIB
    python -m proving_ground.experiments.papers.receivers MatRTKLIB/examples/data

The records are solutions of RTKLIB: a receiver at rest 1 m from its base (300 s, 1 Hz) and one on a
car in Nagoya 9 km from its base (1,230 s, 5 Hz), whose reference comes from a survey-grade inertial
system. T. Suzuki, MIT licence. They are not part of this package; the table of figures is.

Errors are those about the mean of their regime, since a constant offset moves path and vehicle
alike. About one mean of all regimes they are 22, 23 and 33 mm with a length of 9 m; the difference
is slow, and may be the receiver's or the reference's.

What the record cannot tell: errors of the reference, some centimetres where it saw few satellites,
count as the receiver's. RTKLIB resolved the ambiguities of each epoch alone, so that fix and float
change more often than in a receiver that holds its fix. There was one antenna.
"""

import argparse
import math
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import tomli_w
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from ttempc.types import FloatArray

from ...testbed.sensing.receivers import TABLE
from ..errors import ExperimentError

FILES: Final = ("static/rover_rtk.pos", "kinematic/rover_rtk.pos", "kinematic/reference.csv")
WRONG_M: Final = 0.3  # a fix farther off than this is wrong
SATELLITES: Final = 8  # epochs with fewer are left out
MOVING_MPS: Final = 1.0
REGIMES: Final = {"open-sky": (0.99, 1.01), "wood": (0.5, 0.99), "street": (0.1, 0.5)}
"""Share of fixed epochs in the 20 s around an epoch. Below a tenth nothing guides a machine."""
HALF_WINDOW_S: Final = 10.0
LAGS_M: Final = ((0.2, 1.0), (1.0, 3.0), (3.0, 6.0), (6.0, 12.0), (12.0, 25.0), (25.0, 50.0))
LAGS_S: Final = (1, 2, 5, 10, 20, 30, 60)  # lags of the receiver at rest [s]
SINCE_M: Final = (0.0, 0.01, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)  # travelled since the fix was lost
GAP_S: Final = 0.25  # epochs farther apart do not follow each other
AXIS: Final = 68.27  # percentile of an absolute normal variable at its standard deviation

Mask = NDArray[np.bool_]


class Drive(NamedTuple):
    """Record of a moving receiver, a line an epoch; errors are ahead and to the right, (n, 2)."""

    time: FloatArray  # [s]
    speed: FloatArray  # [m/s]
    distance: FloatArray  # [m] travelled
    error: FloatArray  # (n, 2) [m] less constant offsets of map and mounting
    fixed: Mask
    share: FloatArray  # of fixed epochs around

    @property
    def wrong(self) -> Mask:
        """Fixed epochs that are wrong."""
        return self.fixed & (np.hypot(*self.error.T) > WRONG_M)


def read_positions(file: Path) -> FloatArray:
    """Return time [s], latitude, longitude [deg], height [m], quality, satellites of a solution."""
    lines = [line.split() for line in file.read_text().splitlines() if line[:1] != "%"]

    def seconds(clock: str) -> float:
        """Return seconds of the week, or of the day from hours:minutes:seconds."""
        return sum(float(part) * 60.0**n for n, part in enumerate(reversed(clock.split(":"))))

    return np.array([[seconds(line[1]), *map(float, line[2:7])] for line in lines])


def east_north(position: FloatArray, origin: FloatArray) -> FloatArray:
    """Return differences of latitude and longitude [deg] as (n, 2) [m] on the WGS 84 ellipsoid."""
    sine = np.sin(np.radians(origin[:, 0]))
    flat = 1.0 - 6.69437999014e-3 * sine**2
    across = 6378137.0 / np.sqrt(flat)
    north, east = np.radians(position - origin).T
    along = across * (1.0 - 6.69437999014e-3) / flat
    return np.column_stack([east * across * np.sqrt(1.0 - sine**2), north * along])


def read_drive(folder: Path) -> Drive:
    """Return the record of the car."""
    found = read_positions(folder / FILES[1])
    truth = np.genfromtxt(folder / FILES[2], delimiter=",", skip_header=1)
    known = [np.interp(found[:, 0], truth[:, 0], truth[:, i]) for i in (2, 3, 11, 12)]
    heading = np.radians(np.interp(found[:, 0], truth[:, 0], np.unwrap(truth[:, 10], period=360)))
    east, north = east_north(found[:, 1:3], np.column_stack(known[:2])).T
    sine = np.sin(heading)
    cosine = np.cos(heading)
    error = np.column_stack([east * sine + north * cosine, east * cosine - north * sine])
    time = found[:, 0]
    speed = np.hypot(*known[2:])
    fixed = found[:, 4] == 1
    step = np.diff(time, prepend=time[0])
    seen = found[:, 5] >= SATELLITES
    share = [fixed[np.abs(time - one) < HALF_WINDOW_S].mean() for one in time]
    correct = fixed & seen & (np.hypot(*error.T) < WRONG_M) & (speed > MOVING_MPS)
    # constant offsets of the map, and of the antenna from the reference's point
    one = np.ones_like(sine)
    zero = np.zeros_like(sine)
    ahead, right = np.array([[sine, cosine, one, zero], [cosine, -sine, zero, one]])  # (4, n)
    chosen = np.hstack([ahead[:, correct], right[:, correct]]).T
    offset = np.linalg.lstsq(chosen, error[correct].T.ravel(), rcond=None)[0]
    error = error - np.column_stack([offset @ ahead, offset @ right])
    distance = np.cumsum(speed * step)
    return Drive(
        time[seen], speed[seen], distance[seen], error[seen], fixed[seen], np.array(share)[seen]
    )


def second_order(u: FloatArray) -> FloatArray:
    """Return the autocorrelation of a second-order Gauss-Markov process at lags."""
    return (1.0 + u) * np.exp(-u)


def at_rest(folder: Path) -> dict[str, Any]:
    """Return the statistics of the receiver at rest, and the correlation time that fits them."""
    found = read_positions(folder / FILES[0])
    error = east_north(found[:, 1:3], np.tile(found[:, 1:3].mean(axis=0), (len(found), 1)))
    product = [float(np.mean(error[:-lag] * error[lag:])) for lag in LAGS_S]
    record = np.array(product) / np.mean(error**2)
    lags = np.array(LAGS_S, dtype=float)
    fit = least_squares(
        lambda p: p[0] * second_order(lags / p[1]) - record, [0.5, 20.0], bounds=([0, 1], [1, 900])
    )
    return {
        "epochs": len(found),
        "sd_m": float(np.sqrt(np.mean(error**2))),
        "lag_s": [*LAGS_S],
        "autocorrelation": record.tolist(),
        "correlation_time_s": float(fit.x[1]),
    }


def correlation(drive: Drive, chosen: list[Mask], time_s: float) -> dict[str, Any]:
    """Return the autocorrelation of correct fixes in motion, and the fitted length.

    Errors are those about the mean of their group of epochs. The white share and the
    length of a second-order Gauss-Markov process fit the record at its mean lags. So does the
    share of the variance that is in the means: removing these lowers the record at every lag.
    """
    rows = []
    for low, high in LAGS_M:
        products = []
        for own in chosen:
            error = drive.error[own] - drive.error[own].mean(axis=0)
            apart, later = (x[own] - x[own][:, None] for x in (drive.distance, drive.time))
            near = (apart >= low) & (apart < high) & (later < 30.0)
            one, other = np.nonzero(near)
            both = (error[one] * error[other]).sum(axis=1)
            each = 0.5 * (error[one] ** 2 + error[other] ** 2).sum(axis=1)
            products.append(np.column_stack([later[near], apart[near], both, each]))
        rows.append(np.concatenate(products).mean(axis=0))
    later, apart, both, each = np.array(rows).T
    record = both / each  # by the variance of the very pairs

    def model(p: FloatArray) -> FloatArray:
        return (p[0] * second_order(later / time_s + apart / p[1]) - p[2]) / (1.0 - p[2])

    bounds = ([0.0, 1.0, 0.0], [1.0, 500.0, 0.5])
    fit = least_squares(lambda p: model(p) - record, [0.9, 5.0, 0.1], bounds=bounds)
    return {
        "lag_m": apart.tolist(),
        "lag_s": later.tolist(),
        "autocorrelation": record.tolist(),
        "fitted": model(fit.x).tolist(),
        "variance_in_means": float(fit.x[2]),
        "correlation_length_m": float(fit.x[1]),
    }


def rates(drive: Drive, own: Mask, fixed: bool) -> tuple[float, float]:
    """Return the rates per second and per metre at which a fix is lost, or found again.

    They are those of largest likelihood of a chain that leaves its state at a + b v.
    """
    step = np.diff(drive.time)
    used = own[:-1] & (step < GAP_S) & (drive.fixed[:-1] == fixed)
    left = drive.fixed[1:][used] != fixed
    speed = drive.speed[:-1][used]
    step = step[used]
    if not left.any():
        return 0.0, 0.0

    def misfit(p: FloatArray) -> float:
        expected = (p[0] + p[1] * speed) * step + 1e-12
        return float(expected[~left].sum() - np.log(-np.expm1(-expected[left])).sum())

    fit = minimize(misfit, [0.1, 0.03], bounds=[(0.0, 9.0), (0.0, 9.0)])
    return float(fit.x[0]), float(fit.x[1])


def float_errors(drive: Drive, own: Mask) -> dict[str, Any]:
    """Return deviations of an axis of float solutions over the distance since the fix was lost.

    The deviation of a process that starts with one value and tends to another is fitted to them:
    s^2 = first^2 e + float^2 (1 - e), e = exp(-2 ds / length).
    """
    lost = np.flatnonzero(drive.fixed[:-1] & ~drive.fixed[1:]) + 1
    last = lost[np.maximum(np.searchsorted(lost, np.arange(len(own)), side="right") - 1, 0)]
    since = drive.distance - drive.distance[last]
    apart = []
    record = []
    for low, high in pairwise(SINCE_M):
        near = own & ~drive.fixed & (since >= low) & (since < high)
        if near.any():
            apart.append(float(since[near].mean()))
            record.append(float(np.percentile(np.abs(drive.error[near]), AXIS)))
    distance = np.array(apart)

    def model(p: FloatArray) -> FloatArray:
        kept = np.exp(-2.0 * distance / p[2])
        return 0.5 * np.log(p[0] ** 2 * kept + p[1] ** 2 * (1.0 - kept))

    fit = least_squares(
        lambda p: model(p) - np.log(record), [0.05, 0.3, 5.0], bounds=([0.01] * 3, [1, 9, 99])
    )
    names = ("float_first_sd_m", "float_sd_m", "float_length_m")
    fits = dict(zip(names, fit.x.tolist(), strict=True))
    return {"float_lag_m": apart, "float_sds_m": record, **fits}


def regime(drive: Drive, own: Mask) -> dict[str, Any]:
    """Return statistics and parameters of the epochs of a regime."""
    fixed = drive.fixed
    wrong = drive.wrong
    correct = own & fixed & ~wrong & (drive.speed > MOVING_MPS)
    follows = np.diff(drive.time, prepend=math.inf) < GAP_S
    three = correct[2:] & correct[1:-1] & correct[:-2] & follows[2:] & follows[1:-1]
    second = drive.error[2:] - 2.0 * drive.error[1:-1] + drive.error[:-2]
    change = own & follows & (fixed != np.roll(fixed, 1)) & (drive.speed > MOVING_MPS)
    step = np.hypot(*(drive.error - np.roll(drive.error, 1, axis=0))[change].T)
    size = np.hypot(*drive.error[own & wrong].T)
    result = {
        "epochs": int(own.sum()),
        "epochs_of_correct_fixes_in_motion": int(correct.sum()),
        "mean_speed_mps": float(drive.speed[own].mean()),
        "fixed_share": float(fixed[own].mean()),
        "sd_m": float(np.sqrt(np.mean(np.var(drive.error[correct], axis=0)))),
        "white_sd_m": float(np.sqrt(np.mean(second[three] ** 2) / 6.0)),
        "wrong_share": float(wrong[own & fixed].mean()),
        "wrong_sd_m": float(np.median(size)) / math.sqrt(math.log(4.0)) if len(size) else 0.0,
        "median_step_m": float(np.median(step)) if len(step) else 0.0,
    }
    for state, name in ((True, "lost"), (False, "found")):
        result |= zip((f"{name}_per_s", f"{name}_per_m"), rates(drive, own, state), strict=True)
    if not fixed[own].all():
        result |= float_errors(drive, own)
    return result


def fitted(folder: Path) -> dict[str, Any]:
    """Return the table of `testbed.sensing.receivers`.

    Raises:
        ExperimentError: a record is missing.
    """
    if missing := [name for name in FILES if not (folder / name).is_file()]:
        raise ExperimentError(
            f"{folder}: no {', '.join(missing)}; the folder is examples/data of "
            "github.com/taroz/MatRTKLIB (MIT licence)"
        )
    drive = read_drive(folder)
    rest = at_rest(folder)
    masks = {
        name: (drive.share >= low) & (drive.share < high) for name, (low, high) in REGIMES.items()
    }
    good = drive.fixed & ~drive.wrong & (drive.speed > MOVING_MPS)
    chosen = [good & own for own in masks.values()]
    moving = correlation(drive, chosen, rest["correlation_time_s"])
    return {"rest": rest, "motion": moving} | {n: regime(drive, m) for n, m in masks.items()}


def _short(value: Any) -> Any:  # noqa: ANN401 - of a table
    """Return a table with numbers of three digits."""
    match value:
        case dict():
            return {key: _short(item) for key, item in value.items()}
        case list():
            return [_short(item) for item in value]
        case float():
            return float(f"{value:.3g}")
        case _:
            return value


def main() -> int:
    """Execute the command and return its exit code."""
    parser = argparse.ArgumentParser(prog="receivers", description="fit receivers to records")
    parser.add_argument("folder", type=Path, help="examples/data of github.com/taroz/MatRTKLIB")
    parser.add_argument("-o", "--out", type=Path, default=TABLE, help="TOML file (%(default)s)")
    arguments = parser.parse_args()
    try:
        table = _short(fitted(arguments.folder))
    except (ExperimentError, OSError, ValueError) as error:
        print(f"receivers: {error}", file=sys.stderr)
        return 2
    head = "# Made by experiments/papers/receivers.py, which says from what; not to be edited.\n"
    arguments.out.write_text(head + tomli_w.dumps(table), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
