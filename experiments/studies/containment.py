"""How often does reality stay inside the tube?  Fitted on some seeds, counted on others.

    python -m experiments.studies.containment DIR --laps 200 [--only grass-soil grass-150kpa]

Every lap is a run of one lap with a seed of its own. A case with a tube of its own fits one to laps
of `ttempc-tube` on its field first; the others borrow that of `grass-soil` and leave what it was
fitted on: soil, load, speed. DIR keeps tubes, a JSON line for every lap and the tracks of the first
ones, so that a study that was stopped goes on where it was, and more laps come on top. Prints the
tables of docs/tube.md; with --figures it draws its pictures from what is in DIR.
"""

from __future__ import annotations

import argparse
import json
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from proving_ground.testbed.recording.channels import TUBE
from ttempc.errors import InvalidTube

from ..errors import InvalidFit
from ..results.confidence import Share, share
from ..results.containment import QUANTITIES, Containment, containment
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..scenario.tube_file import read_tube, to_json
from ..tubes.fit import FitRun, fit_run, fit_tube, format_fit
from .containment_figures import draw

DRIVER: Final = "ttempc-tube"  # of the laps to fit to, in the shipped tube of grass
FIRST_FIT_SEED: Final = 1001
FIRST_SEED: Final = 2001  # of the fresh laps
TRACKS: Final = 30  # laps whose deviations are kept for the figures


@dataclass(frozen=True, slots=True)
class Case:
    """A field with the wheels on it, and whose tube drives there."""

    scenario: str
    changes: tuple[str, ...] = ()
    tube_of: str = ""  # another case; empty for a tube of its own


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
    lines = ["path.laps=1", *case.changes, f'controller.name="{controller}"']
    return lines if tube is None else [*lines, f'controller.tube="{tube.resolve()}"']


def fit_lap(case: Case, seed: int) -> FitRun:
    """Drive a lap to fit a tube to."""
    name, scenario = load(case.scenario, settings(case, DRIVER))
    _, record = simulate(name, scenario, seed)
    about = {"scenario": name, "controller": DRIVER, "seed": str(seed)}
    return fit_run(replace(record, metadata=about), scenario)


def fresh_lap(case: Case, tube: Path, folder: Path, key: str, seed: int) -> dict[str, Any]:
    """Drive a lap in the tube and return its counts; keep its track if it is among the first."""
    name, scenario = load(case.scenario, settings(case, "ttempc-tube", tube))
    summary, record = simulate(name, scenario, seed)
    found = containment(record)
    inside = found.normalised_deviation <= 1.0
    if seed < FIRST_SEED + TRACKS:
        tracks = folder / "tracks"
        tracks.mkdir(exist_ok=True)
        np.savez_compressed(
            tracks / f"{key}-{seed}.npz",
            time_s=found.time_s,
            deviation=found.deviation.astype(np.float32),
            half_width=found.half_width.astype(np.float32),
        )

    def counts(where: NDArray[np.bool_]) -> dict[str, Any]:
        kept = inside[where]
        each = kept.sum(axis=0).tolist()
        points, everything = kept[:, found.POINTS].all(axis=1), kept.all(axis=1)
        return {
            "steps": len(kept),
            "each": each,
            "points": int(points.sum()),
            "all": int(everything.sum()),
        }

    seen = record[TUBE]["inside"][record[TUBE].time_s >= 8.0]
    return {
        "case": key,
        "seed": seed,
        "status": summary.status,
        "straight": counts(~found.curved),
        "curve": counts(found.curved),
        "restarts": int((seen < 0.5).sum()),
        "largest_share": found.normalised_deviation.max(axis=0, initial=0.0).tolist(),
        "cross_error_p95_m": [
            body.cross_p95_m
            for body in (summary.tracking.all.tractor, summary.tracking.all.trailer)
        ],
        "slip_mean": summary.slip.rear_mean,
    }


def refused_file(folder: Path, key: str) -> Path:
    """Return where it stands why no tube drives a case."""
    return folder / f"{key}-refused.txt"


def tube_of(key: str, folder: Path, laps: int, pool: ProcessPoolExecutor) -> Path | None:
    """Return the tube file of a case, fitted now if it is not there; None where there is none."""
    file = folder / f"{key}.json"
    refused = refused_file(folder, key)
    if file.exists() or refused.exists():
        return file if file.exists() else None
    driven = pool.map(partial(fit_lap, CASES[key]), range(FIRST_FIT_SEED, FIRST_FIT_SEED + laps))
    runs = list(tqdm(driven, total=laps, desc=f"{key}: to fit"))
    try:
        fit = fit_tube(runs)
    except (InvalidFit, InvalidTube) as error:
        refused.write_text(f"{error}\n", encoding="utf-8")
        return None
    (folder / f"{key}.txt").write_text(format_fit(fit) + "\n", encoding="utf-8")
    file.write_text(to_json(fit.file), encoding="utf-8")
    return file


def rows(folder: Path) -> list[dict[str, Any]]:
    """Return the laps that are in the folder; a line that was cut off counts as not driven."""
    file = folder / "laps.jsonl"
    found = []
    for line in file.read_text(encoding="utf-8").splitlines() if file.exists() else []:
        try:
            found.append(json.loads(line))
        except json.JSONDecodeError:
            continue
    return found


def drive(folder: Path, keys: Sequence[str], laps: int, fit_laps: int) -> None:
    """Drive what is missing of the cases."""
    done = {(row["case"], row["seed"]) for row in rows(folder)}
    with ProcessPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        for key in keys:
            case = CASES[key]
            tube = tube_of(case.tube_of or key, folder, fit_laps, pool)
            seeds = [FIRST_SEED + lap for lap in range(laps)]
            seeds = [seed for seed in seeds if (key, seed) not in done]
            if tube is None or not seeds or refused_file(folder, key).exists():
                continue
            driven = pool.map(partial(fresh_lap, case, tube, folder, key), seeds)
            try:
                for row in tqdm(driven, total=len(seeds), desc=key):
                    with (folder / "laps.jsonl").open("a", encoding="utf-8") as file:
                        file.write(json.dumps(row) + "\n")
            except InvalidTube as error:  # a borrowed one, along another reference
                refused_file(folder, key).write_text(f"{error}\n", encoding="utf-8")


def table(folder: Path) -> Iterator[str]:
    """Yield the lines of the tables: by case, then by quantity."""
    by_case: dict[str, list[dict[str, Any]]] = {}
    for row in rows(folder):
        by_case.setdefault(row["case"], []).append(row)
    heads = ("case", "laps", "lost", "steps with both points inside", "straight", "curve")
    more = ("laps wholly inside", "restarts a lap", "largest share of a cross-track half width")
    yield f"| {' | '.join((*heads, *more))} |"
    yield "|---" * 9 + "|"
    for key, laps in by_case.items():
        points = {w: _counted(laps, w, "points") for w in ("straight", "curve")}
        both = share(
            points["straight"].inside + points["curve"].inside,
            points["straight"].total + points["curve"].total,
        )
        whole = share(sum(_whole(lap) for lap in laps), len(laps))
        lost = sum(lap["status"] != "completed" for lap in laps)
        restarts = sum(lap["restarts"] for lap in laps) / len(laps)
        used = np.max([lap["largest_share"] for lap in laps], axis=0)[
            [*Containment.ACROSS.values()]
        ].max()
        yield (
            f"| `{key}` | {len(laps)} | {lost} | {both} | {points['straight'].fraction:.4f} | "
            f"{points['curve'].fraction:.4f} | {whole} | {restarts:.2f} | {used:.2f} |"
        )
    yield ""
    yield f"| case | {' | '.join(QUANTITIES)} |"
    yield "|---" * (1 + len(QUANTITIES)) + "|"
    for key, laps in by_case.items():
        each = np.sum([lap[w]["each"] for lap in laps for w in ("straight", "curve")], axis=0)
        steps = sum(lap[where]["steps"] for lap in laps for where in ("straight", "curve"))
        yield f"| `{key}` | " + " | ".join(f"{one / steps:.4f}" for one in each) + " |"
    for file in sorted(folder.glob("*-refused.txt")):
        yield f"\n`{file.stem.removesuffix('-refused')}`: {file.read_text().strip()}"


def _counted(laps: Sequence[dict[str, Any]], where: str, what: str) -> Share:
    return share(sum(lap[where][what] for lap in laps), sum(lap[where]["steps"] for lap in laps))


def _whole(lap: dict[str, Any]) -> bool:
    """Whether both points were inside at every tick of a lap that was driven to its end."""
    inside = all(lap[where]["points"] == lap[where]["steps"] for where in ("straight", "curve"))
    return inside and lap["status"] == "completed"


def main() -> None:
    """Drive, then print."""
    parser = argparse.ArgumentParser(description="count how often reality stays inside the tube")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--laps", type=int, default=10)
    parser.add_argument("--fit-laps", type=int, default=12, help="a third of them held out")
    parser.add_argument("--only", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--figures", action="store_true")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    drive(arguments.folder, arguments.only, arguments.laps, arguments.fit_laps)
    print("\n".join(table(arguments.folder)))
    if arguments.figures:
        design = read_tube(str(arguments.folder / f"{BORROWED}.json")).design()
        draw(arguments.folder, design, rows(arguments.folder), BORROWED)


if __name__ == "__main__":
    main()
