"""Tables made from sweeps and from what studies in Python print."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from ...testbed.recording.provenance import code_digest
from ..benchmarks.performance import page
from ..results.leads import RunError, leads_sentence
from ..studies import cards, containment, front, ranking
from ..studies.evidence.page import evidence_page
from ..sweep.results import rows
from ..sweep_report.format import format_estimate
from ..sweep_report.report import docs_page, make_report
from ..sweep_report.runs import differences, groups
from .comparison import DEFAULT, run_errors
from .comparison_tables import table
from .driver import Driver
from .entry import Product

SWEEPS = ("terrain-slip", "delay", "noise", "speed-radius", "mismatch")
"""Studies with a page of their own in docs/results."""

CONTAINMENT_LAPS = 12
"""Fresh laps in each case of the containment study."""

RANKING_DRAWS = 12
"""Drawn plants of the ranking, each with a seed of its own."""


def performance(driver: Driver) -> Product:
    """Return the benchmarks of cost and speed on this machine."""
    return Product(*page())


def sweep_page(study: str) -> Callable[[Driver], Product]:
    """Return the function that makes the page of a sweep, with its pictures."""
    return partial(_sweep_page, study)


def _sweep_page(study: str, driver: Driver) -> Product:
    return Product(*docs_page(make_report(driver.sweep(study), against="ttempc")))


def studies(driver: Driver) -> Product:
    """Return the errors of all sweeps side by side, with the difference of `pid`, and all leads."""
    lines: list[tuple[str, ...]] = []
    errors: list[RunError] = []
    for name in SWEEPS:
        errors += run_errors(rows(driver.rows(name) / "results.jsonl"), name)
        runs = driver.sweep(name)
        by_controller = groups(runs).set_index("controller")
        difference = differences(runs, "ttempc").set_index("controller").loc["pid"]
        cells = []
        for controller in ("ttempc", "pid", "paper"):
            group = by_controller.loc[controller]
            lost = len(group["failed"])
            of_all = f", {lost} of {len(group['runs'])} lost" if lost else ""
            cells.append(format_estimate(group["error"]) + of_all)
        cells.append(f"{format_estimate(difference['error'], sign='+')} of {difference['pairs']}")
        link = f"[{name}](results/{name}.md)"
        lines.append((link, str(len(runs.rows)), runs.study.description, *cells))
    heads = ("study", "runs", "varied", "`ttempc`", "`pid`", "`paper`", "`pid` - `ttempc`, pairs")
    return Product(f"{table(heads, lines)}\n\n{leads_sentence(errors, DEFAULT, 'studies')}")


def printed(
    main: Callable[..., object], arguments: tuple[object, ...], seeds: tuple[int, ...], fenced: bool
) -> Callable[[Driver], Product]:
    """Return the function that makes a table of what the `main` of a study prints.

    Args:
        main: of the study.
        arguments: of `main`.
        seeds: last argument of `main`, if it takes any.
        fenced: whether it prints lines of text, not Markdown.
    """
    return partial(_printed, main, arguments, seeds, fenced)


def _printed(
    main: Callable[..., object],
    arguments: tuple[object, ...],
    seeds: tuple[int, ...],
    fenced: bool,
    driver: Driver,
) -> Product:
    given = (*arguments, driver.seeds(seeds)) if seeds else arguments
    text = driver.printed(main, *given).strip()
    return Product(f"```text\n{text}\n```" if fenced else text)


def plant_validation(driver: Driver) -> Product:
    """Return the failed checks of every scenario's plant, and the pages of all checks."""
    with tempfile.TemporaryDirectory() as folder:
        text = driver.printed(cards.main, Path(folder))
        files = {file.name: file.read_bytes() for file in Path(folder).iterdir()}
    return Product(text, files)


def ranked(driver: Driver) -> Product:
    """Return whether the order of the controllers survives changes of assumed values."""
    return Product(driver.printed(ranking.main, len(driver.report_seeds(RANKING_DRAWS))).strip())


def evidence(driver: Driver) -> Product:
    """Return the page of published figures beside those of the plant."""
    return Product(driver.printed(_print_evidence).strip())


def _print_evidence() -> None:
    print(evidence_page())


def fronts(driver: Driver) -> Product:
    """Return the errors of controllers over the travel of the hydrostat, with a picture."""
    with tempfile.TemporaryDirectory() as folder:
        text = driver.printed(front.main, driver.report_seeds(2), Path(folder)).strip()
        picture = (Path(folder) / front.FILE).read_bytes()
    return Product(f"![Error over hydrostat travel]({front.FILE})\n\n{text}", {front.FILE: picture})


def contained(driver: Driver) -> Product:
    """Return how often the true state stays in the tube, with pictures."""
    folder = driver.folder / code_digest() / "containment"
    laps = str(len(driver.report_seeds(CONTAINMENT_LAPS)))
    text = driver.printed(containment.main, [str(folder), "--laps", laps, "--figures"])
    return Product(text, {f"tube/{file.name}": file.read_bytes() for file in folder.glob("*.png")})
