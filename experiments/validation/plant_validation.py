"""The card of a scenario's plant: the checks of `testbed.inspection` as lines, JSON, a page."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from proving_ground.testbed.inspection.bench import Bench
from proving_ground.testbed.inspection.check import Chart, Check, number
from proving_ground.testbed.inspection.inspect import EXPERIMENTS, inspect
from proving_ground.testbed.recording.provenance import versions

from ..figures import png
from ..output import make_folder, refuse_existing
from ..report.page import Picture, environment
from ..run.assembly import assemble
from ..scenario.scenario import Scenario, dump
from .figure import chart_figure

_SEED: Final = 1  # draws the terrain


@dataclass(frozen=True, slots=True)
class Card:
    """What the inspection of one scenario's plant found."""

    scenario: str
    wheels: str
    versions: dict[str, str]
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Return whether every check that applies holds."""
        return all(check.passed is not False for check in self.checks)

    def to_json(self) -> str:
        """Return the card as JSON; its keys are an interface. `null` stands for no number."""
        content = {
            "scenario": self.scenario,
            "wheels": self.wheels,
            "passed": self.passed,
            "versions": self.versions,
            "checks": [
                {
                    "name": check.name,
                    "figure": _finite(check.figure),
                    "unit": check.unit,
                    "expectation": check.expectation,
                    "low": _finite(check.low),
                    "high": _finite(check.high),
                    "source": check.source,
                    "passed": check.passed,
                    "note": check.note,
                }
                for check in self.checks
            ],
        }
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def bench(scenario: Scenario) -> Bench:
    """Return the bench with the scenario's vehicle, wheels and ground, behind faultless valves.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible.
    """
    ground, plant = scenario.terrain, assemble(scenario, _SEED).plant
    of_a_class = ground.iso_class != "flat" and not ground.height_map
    return Bench(
        vehicle=plant.vehicle,
        terrain=plant.terrain,
        soil=plant.soil,
        rough=replace(ground, features=()).terrain(_SEED) if of_a_class else None,
        iso_class=ground.iso_class,
        slope_rad=ground.slope_rad,
        wheels=scenario.plant.wheels,
        timestep_s=plant.timestep_s,
    )


def make_card(
    name: str,
    scenario: Scenario,
    experiments: Sequence[str] = tuple(EXPERIMENTS),
    on_check: Callable[[Check], object] = lambda check: None,
) -> Card:
    """Inspect the plant of a scenario; nothing is written.

    Args:
        name: of the scenario.
        scenario: whose plant.
        experiments: names out of `EXPERIMENTS`.
        on_check: is called with each check as it is made.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible.
    """
    checks = []
    for check in inspect(bench(scenario), experiments):
        on_check(check)
        checks.append(check)
    return Card(name, scenario.plant.wheels, versions(), tuple(checks))


def write_card(
    name: str, scenario: Scenario, folder: Path, on_check: Callable[[Check], object]
) -> Card:
    """Inspect the plant of a scenario; write card.json, card.html and the figures to `folder`.

    Raises:
        OutputExists: the folder exists already; nothing is written.
        ExperimentError, TestbedError, TtempcError: the scenario asks for something impossible;
            nothing is written.
    """
    refuse_existing(folder)
    card = make_card(name, scenario, on_check=on_check)
    make_folder(folder)
    (folder / "card.json").write_text(card.to_json(), encoding="utf-8")
    pictures = {}
    for check in card.checks:
        if check.chart is not None:
            pictures[_stem(check.chart)] = (check.chart.title, png(chart_figure(check.chart)))
    for stem, (_, content) in pictures.items():
        (folder / f"{stem}.png").write_bytes(content)
    shown = [Picture.of(stem, title, content) for stem, (title, content) in pictures.items()]
    (folder / "card.html").write_text(page(card, dump(scenario), shown), encoding="utf-8")
    return card


def page(card: Card, scenario_toml: str, pictures: Sequence[Picture]) -> str:
    """Return the text of `card.html`."""
    counts = dict.fromkeys(("pass", "FAIL", "not applicable"), 0)
    for check in card.checks:
        counts[check.verdict] += 1
    return (
        environment()
        .get_template("card.html.j2")
        .render(
            card=card,
            counts=counts,
            rows=[(check, figure_text(check)) for check in card.checks],
            pictures=pictures,
            scenario_toml=scenario_toml,
        )
    )


def line(check: Check) -> str:
    """Return a check as a line of text."""
    if check.passed is None:
        return f"{'n/a':<5} {check.name}: {check.note}"
    note = f" ({check.note})" if check.note else ""
    return (
        f"{check.verdict:<5} {check.name}: {figure_text(check)}, "
        f"expected {check.expectation} [{check.source}]{note}"
    )


def figure_text(check: Check) -> str:
    """Return the figure with its unit."""
    return "–" if check.figure is None else f"{number(check.figure)} {check.unit}".rstrip()


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None


def _stem(chart: Chart) -> str:
    return re.sub(r"[^a-z0-9]+", "-", chart.title.lower()).strip("-")


def summary_line(card: Card) -> str:
    """Return how many checks hold."""
    failed = sum(check.passed is False for check in card.checks)
    skipped = sum(check.passed is None for check in card.checks)
    return (
        f"{card.scenario}, {card.wheels} wheels: {len(card.checks) - failed - skipped} of "
        f"{len(card.checks) - skipped} checks hold"
        + (f", {skipped} do not apply" if skipped else "")
    )
