"""Containment of the plant in the tube: fitted on some seeds, counted on others.

    python -m experiments.studies.containment DIR --laps 200 [--only grass-soil grass-300kpa]

Every lap is a run of one lap with its own seed. A case with its own tube first fits it to laps of
`ttempc-tube` on its field, then calibrates it on further laps in this tube. The other cases use the
tube of `grass-soil` under conditions that it was neither fitted nor calibrated to: soil, load,
speed. DIR keeps the tubes, a JSON line per lap and the tracks of the
first laps: an interrupted study resumes, and more laps can be added. Prints the table of
docs/tube.md; --figures draws its pictures from the content of DIR.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ttempc.errors import InvalidTube

from ...testbed.recording.channels import TUBE
from ..errors import InvalidFit
from ..results.containment import Containment, containment
from ..results.statistics import Proportion, proportion
from ..results.tracking_errors import START_UP_S
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..scenario.tube_file import read_tube, to_json
from ..seeds import FIRST, FITTING
from ..tubes.calibration import DrivenRun, calibrate_tube, driven_run, format_calibration
from ..tubes.fit import FitRun, fit_run, fit_tube, format_fit
from .batch import run_tasks
from .containment_figures import draw_containment

DRIVER: Final = "ttempc-tube"  # of the laps that a tube is fitted to
FIRST_FIT_SEED: Final = FITTING.start
FIRST_SEED: Final = FIRST  # of the fresh laps
LAPS_COVERAGE: Final = 0.95  # of the calibration
TRACKS: Final = 30  # laps whose deviations are kept for the figures


@dataclass(frozen=True, slots=True)
class Case:
    """A field with its overrides, and the tube to drive in."""

    scenario: str
    changes: tuple[str, ...] = ()
    tube_of: str = ""  # the case whose tube is used; empty: its own
    path: str = "path.laps=1"


BORROWED: Final = "grass-soil"
CASES: Final = {
    "grass-soil": Case("grass"),
    "grass-contact": Case("grass", ('plant.wheels="contact"',)),
    "pavement-soil": Case("pavement"),
    "wet-grass-soil": Case("wet-grass"),
    "side-slope-soil": Case("side-slope"),
    "grass-contact-borrowed": Case("grass", ('plant.wheels="contact"',), BORROWED),
    "grass-400kpa": Case("grass", ("soil.cone_index_kpa=400.0",), BORROWED),
    "grass-300kpa": Case("grass", ("soil.cone_index_kpa=300.0",), BORROWED),
    "grass-200kpa": Case("grass", ("soil.cone_index_kpa=200.0",), BORROWED),
    "grass-class-E": Case("grass", ('terrain.iso_class="E"',), BORROWED),
    "grass-class-F": Case("grass", ('terrain.iso_class="F"',), BORROWED),
    "grass-load-400kg": Case("grass", ("plant.vehicle.load_kg=400.0",), BORROWED),
    "grass-0.7mps": Case("grass", ("path.speed_mps=0.7",), BORROWED),
    "grass-1.2mps": Case("grass", ("path.speed_mps=1.2",), BORROWED),
    "wet-grass-borrowed": Case("wet-grass", (), BORROWED),
    "side-slope-borrowed": Case("side-slope", (), BORROWED),
}


def settings(case: Case, controller: str, tube: Path | None = None) -> list[str]:
    """Return the overrides of a lap."""
    lines = [case.path, *case.changes, f'controller.name="{controller}"']
    return lines if tube is None else [*lines, f'controller.tube="{tube.resolve()}"']


def fit_lap(case: Case, seed: int) -> FitRun:
    """Drive a lap that a tube is fitted to."""
    name, scenario = load(case.scenario, settings(case, DRIVER))
    _, record = simulate(name, scenario, seed)
    about = {"scenario": name, "controller": DRIVER, "seed": str(seed)}
    return fit_run(replace(record, metadata=about), scenario)


def calibration_lap(case: Case, tube: Path, seed: int) -> DrivenRun:
    """Drive a lap that a tube is calibrated on."""
    name, scenario = load(case.scenario, settings(case, DRIVER, tube))
    _, record = simulate(name, scenario, seed)
    about = {"scenario": name, "controller": DRIVER, "seed": str(seed)}
    return driven_run(replace(record, metadata=about), scenario)


def fresh_lap(case: Case, tube: Path, folder: Path, key: str, seed: int) -> dict[str, Any]:
    """Drive a lap in the tube and return its counts; keep the tracks of the first laps."""
    name, scenario = load(case.scenario, settings(case, "ttempc-tube", tube))
    summary, record = simulate(name, scenario, seed)
    deviations = containment(record)
    inside = deviations.margin >= 0.0
    if seed < FIRST_SEED + TRACKS:
        tracks = folder / "tracks"
        tracks.mkdir(exist_ok=True)
        np.savez_compressed(
            tracks / f"{key}-{seed}.npz",
            time_s=deviations.time_s,
            deviation=deviations.deviation.astype(np.float32),
            half_width=deviations.half_width.astype(np.float32),
        )

    def counts(where: NDArray[np.bool_]) -> dict[str, Any]:
        return {"steps": int(where.sum()), "points": int(inside[where].sum())}

    membership = record[TUBE]["inside"][record[TUBE].time_s >= START_UP_S]
    return {
        "case": key,
        "seed": seed,
        "status": summary.status,
        "straight": counts(~deviations.curved),
        "curve": counts(deviations.curved),
        "restarts": int((membership < 0.5).sum()),
        "largest_m": np.abs(deviations.deviation[:, deviations.POINTS])
        .max(axis=0, initial=0.0)
        .tolist(),
        "largest_share": deviations.normalised_deviation.max(axis=0, initial=0.0).tolist(),
        "cross_error_p95_m": [
            body.cross_p95_m
            for body in (summary.tracking.all.tractor, summary.tracking.all.trailer)
        ],
        "slip_mean": summary.slip.rear_mean,
    }


def refused_file(folder: Path, key: str) -> Path:
    """Return the file with the reason why no tube drives a case."""
    return folder / f"{key}-refused.txt"


def tube_file(key: str, folder: Path, laps: int) -> Path | None:
    """Return the tube file of a case, fitted if it does not exist; None if the fit is refused."""
    file = folder / f"{key}.json"
    refused = refused_file(folder, key)
    if file.exists() or refused.exists():
        return file if file.exists() else None
    seeds = range(FIRST_FIT_SEED, FIRST_FIT_SEED + laps)
    try:
        fit = fit_tube(list(run_tasks(partial(fit_lap, CASES[key]), seeds, f"{key}: laps to fit")))
    except (InvalidFit, InvalidTube) as error:
        refused.write_text(f"{error}\n", encoding="utf-8")
        return None
    (folder / f"{key}.txt").write_text(format_fit(fit) + "\n", encoding="utf-8")
    file.write_text(to_json(fit.file), encoding="utf-8")
    return file


def calibrate_file(key: str, file: Path, seeds: Sequence[int]) -> None:
    """Calibrate the tube file of a case on laps driven in it, if it is not calibrated."""
    if not seeds or read_tube(str(file)).calibration is not None:
        return
    lap = partial(calibration_lap, CASES[key], file)
    laps = list(run_tasks(lap, seeds, f"{key}: laps to calibrate"))
    calibrated = calibrate_tube(laps, LAPS_COVERAGE)
    with file.with_suffix(".txt").open("a", encoding="utf-8") as text:
        text.write(f"\n{format_calibration(calibrated)}\n")
    partly = file.with_suffix(".json.part")
    partly.write_text(to_json(calibrated), encoding="utf-8")
    partly.replace(file)


def read_laps(folder: Path) -> list[dict[str, Any]]:
    """Return the laps in the folder, without incomplete lines."""
    file = folder / "laps.jsonl"
    laps = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
        try:
            laps.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return laps


def drive_cases(
    folder: Path, keys: Sequence[str], laps: int, fit_laps: int, calibration_laps: int
) -> None:
    """Drive the laps of the cases that are not in the folder."""
    first = FIRST_FIT_SEED + fit_laps
    calibration_seeds = range(first, first + calibration_laps)
    done = {(row["case"], row["seed"]) for row in read_laps(folder)}
    for key in keys:
        case = CASES[key]
        owner = case.tube_of or key
        tube = tube_file(owner, folder, fit_laps)
        if tube is not None:
            calibrate_file(owner, tube, calibration_seeds)
        seeds = [FIRST_SEED + lap for lap in range(laps)]
        seeds = [seed for seed in seeds if (key, seed) not in done]
        if tube is None or not seeds or refused_file(folder, key).exists():
            continue
        try:
            for row in run_tasks(partial(fresh_lap, case, tube, folder, key), seeds, key):
                with (folder / "laps.jsonl").open("a", encoding="utf-8") as file:
                    file.write(json.dumps(row) + "\n")
        except InvalidTube as error:  # the tube of another case, along another reference
            refused_file(folder, key).write_text(f"{error}\n", encoding="utf-8")


def table(folder: Path) -> Iterator[str]:
    """Yield the lines of the table, a case each, and the reasons of cases without a tube."""
    by_case: dict[str, list[dict[str, Any]]] = {}
    for row in read_laps(folder):
        by_case.setdefault(row["case"], []).append(row)
    heads = [
        "case",
        "laps",
        "lost",
        "steps with both points inside",
        "straight",
        "curve",
        "laps wholly inside",
        "restarts a lap",
        "largest share of a cross-track half width",
        "calibrated across, tractor / trailer [cm]",
        "promised",
        "laps inside the calibrated widths",
    ]
    yield f"| {' | '.join(heads)} |"
    yield "|---" * len(heads) + "|"
    for key, laps in by_case.items():
        points = {w: _counted(laps, w) for w in ("straight", "curve")}
        both = sum(one.count for one in points.values()) / sum(one.total for one in points.values())
        whole = proportion(sum(_whole(lap) for lap in laps), len(laps))
        lost = sum(lap["status"] != "completed" for lap in laps)
        restarts = sum(lap["restarts"] for lap in laps) / len(laps)
        used = np.max([lap["largest_share"] for lap in laps], axis=0)[
            [*Containment.ACROSS.values()]
        ].max()
        yield (
            f"| `{key}` | {len(laps)} | {lost} | {both:.4f} | {points['straight'].value:.4f} | "
            f"{points['curve'].value:.4f} | {whole} | {restarts:.2f} | {used:.2f} | "
            f"{_calibration_cells(folder, key, laps)} |"
        )
    for file in sorted(folder.glob("*-refused.txt")):
        yield f"\n`{file.stem.removesuffix('-refused')}`: {file.read_text().strip()}"


def _counted(laps: Sequence[dict[str, Any]], where: str) -> Proportion:
    return proportion(
        sum(lap[where]["points"] for lap in laps), sum(lap[where]["steps"] for lap in laps)
    )


def _calibration_cells(folder: Path, key: str, laps: Sequence[dict[str, Any]]) -> str:
    """Return the calibrated half widths, their promise and the laps that keep to them."""
    calibration = read_tube(str(folder / f"{CASES[key].tube_of or key}.json")).calibration
    if calibration is None:
        return "– | – | –"
    widths = calibration.half_widths
    kept = [
        lap["status"] == "completed" and bool(np.all(np.array(lap["largest_m"]) <= astuple(widths)))
        for lap in laps
    ]
    promised = "–" if CASES[key].tube_of else f"{calibration.guaranteed:.4f}"
    return (
        f"{100.0 * widths.tractor_across_m:.1f} / {100.0 * widths.trailer_across_m:.1f} | "
        f"{promised} | {proportion(sum(kept), len(laps))}"
    )


def _whole(lap: dict[str, Any]) -> bool:
    """Return whether a lap completed with both points inside at every tick."""
    inside = all(lap[where]["points"] == lap[where]["steps"] for where in ("straight", "curve"))
    return inside and lap["status"] == "completed"


def main(arguments: Sequence[str] | None = None) -> None:
    """Drive the missing laps, then print the table."""
    parser = argparse.ArgumentParser(description="count how often the plant stays inside the tube")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--laps", type=int, default=10)
    parser.add_argument("--fit-laps", type=int, default=12, help="a third of them held out")
    parser.add_argument(
        "--calibration-laps", type=int, default=24, help="a fifth of them for the scale; 0: none"
    )
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--figures", action="store_true")
    parsed = parser.parse_args(arguments)
    folder: Path = parsed.folder
    folder.mkdir(parents=True, exist_ok=True)
    drive_cases(folder, parsed.only, parsed.laps, parsed.fit_laps, parsed.calibration_laps)
    print("\n".join(table(folder)))
    if parsed.figures:
        design = read_tube(str(folder / f"{BORROWED}.json")).design()
        draw_containment(folder, design, read_laps(folder), BORROWED)


if __name__ == "__main__":
    main()
