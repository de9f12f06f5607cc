"""Plant validation of a scenario: the checks of `testbed.inspection` as text and JSON."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

from ...testbed.inspection.bench import Bench
from ...testbed.inspection.check import Check, number
from ...testbed.inspection.inspect import EXPERIMENTS, inspect
from ...testbed.recording.provenance import versions
from ..run.assembly import assemble
from ..scenario.scenario import Scenario

_SEED: Final = 1  # of the terrain


@dataclass(frozen=True, slots=True)
class PlantValidation:
    """Results of the inspection of one scenario's plant."""

    scenario: str
    wheels: str
    versions: dict[str, str]
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every applicable check passed."""
        return all(check.passed is not False for check in self.checks)

    def to_json(self) -> str:
        """Return the content of card.json. A number that does not exist is `null`."""
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
    """Return the bench with the scenario's vehicle, wheels and ground, and ideal valves.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario is invalid.
    """
    ground, plant = scenario.terrain, assemble(scenario, _SEED).plant
    has_roughness = ground.iso_class != "flat" and not ground.height_map
    return Bench(
        vehicle=plant.vehicle,
        terrain=plant.terrain,
        soil=plant.soil,
        rough=replace(ground, features=()).terrain(_SEED) if has_roughness else None,
        iso_class=ground.iso_class,
        slope_rad=ground.slope_rad,
        wheels=scenario.plant.wheels,
        wheel_law=plant.wheel_law,
        timestep_s=plant.timestep_s,
    )


def validate_plant(
    name: str,
    scenario: Scenario,
    experiments: Sequence[str] = tuple(EXPERIMENTS),
    on_check: Callable[[Check], object] = lambda check: None,
) -> PlantValidation:
    """Inspect the plant of a scenario without writing files.

    Args:
        name: of the scenario.
        scenario: whose plant is inspected.
        experiments: names of the experiments, keys of `EXPERIMENTS`.
        on_check: called with each check when it is complete.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario is invalid.
    """
    checks = []
    for check in inspect(bench(scenario), experiments):
        on_check(check)
        checks.append(check)
    return PlantValidation(name, scenario.plant.wheels, versions(), tuple(checks))


def format_check(check: Check) -> str:
    """Return a check as one line of text."""
    if check.passed is None:
        return f"{'n/a':<5} {check.name}: {check.note}"
    note = f" ({check.note})" if check.note else ""
    return (
        f"{check.verdict:<5} {check.name}: {figure_text(check)}, "
        f"expected {check.expectation} [{check.source}]{note}"
    )


def figure_text(check: Check) -> str:
    """Return the measured value of a check with its unit, a dash if it does not apply."""
    return "–" if check.figure is None else f"{number(check.figure)} {check.unit}".rstrip()


def summary_line(validation: PlantValidation) -> str:
    """Return the number of passed checks as one line of text."""
    counts = Counter(check.verdict for check in validation.checks)
    passed, skipped = counts["pass"], counts["not applicable"]
    return (
        f"{validation.scenario}, {validation.wheels} wheels: {passed} of "
        f"{passed + counts['FAIL']} checks hold" + (f", {skipped} do not apply" if skipped else "")
    )


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
