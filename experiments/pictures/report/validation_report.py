"""Validation report of a scenario's plant: checks as text, JSON and a page with figures."""

import json
import math
import re
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ....testbed.recording.provenance import versions
from ....testbed.validation.bench import Bench
from ....testbed.validation.check import Chart, Check, number
from ....testbed.validation.validate import EXPERIMENTS, validate
from ...output import make_folder, refuse_existing, write_file
from ...run.assembly import assemble
from ...scenario.scenario import Scenario, dump
from ..figures import png
from ..figures.style import BLACK, BLUE, DPI, GREEN, PAGE_WIDTH_IN, RED, dress, legend
from .html import Picture, environment

_SEED: Final = 1  # seed of the scenario's terrain
_COLOURS: Final = (BLUE, RED, GREEN)
_MAX_MARKERS: Final = 25  # lines with more points are drawn without markers


@dataclass(frozen=True, slots=True)
class ValidationReport:
    """Results of all experiments on one scenario's plant."""

    scenario: str
    versions: dict[str, str]
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every applicable check passed."""
        return all(check.passed is not False for check in self.checks)

    @property
    def counts(self) -> Counter[str]:
        """Number of checks by verdict."""
        return Counter(check.verdict for check in self.checks)

    def to_json(self) -> str:
        """Return the content of validation.json. A number that does not exist is `null`."""
        keys = ("name", "figure", "unit", "expectation", "low", "high", "source", "passed", "note")
        content = {
            "scenario": self.scenario,
            "passed": self.passed,
            "versions": self.versions,
            "checks": [
                {key: _finite(getattr(check, key)) for key in keys} for check in self.checks
            ],
        }
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"

    def summary_line(self) -> str:
        """Return the number of passed checks as one line of text."""
        passed, failed, skipped = (
            self.counts[verdict] for verdict in ("pass", "FAIL", "not applicable")
        )
        text = f"{self.scenario}: {passed} of {passed + failed} checks hold"
        return text + (f", {skipped} do not apply" if skipped else "")


def bench(scenario: Scenario) -> Bench:
    """Return the bench with the scenario's vehicle and ground, and ideal valves.

    Raises:
        ExperimentError, TestbedError, TtempcError: the scenario is invalid.
    """
    plant = assemble(scenario, _SEED).plant
    return Bench(
        vehicle=plant.vehicle,
        terrain=plant.terrain,
        soil=plant.soil,
        slope_rad=scenario.terrain.slope_rad,
        wheel_law=plant.wheel_law,
        timestep_s=plant.timestep_s,
    )


def validation_report(
    name: str,
    scenario: Scenario,
    folder: Path | None = None,
    *,
    experiments: Sequence[str] = tuple(EXPERIMENTS),
    on_check: Callable[[Check], object] = lambda check: None,
) -> ValidationReport:
    """Validate the plant of a scenario; with a folder, write validation.json, .html and figures.

    Args:
        name: of the scenario.
        scenario: whose plant is validated.
        folder: to create.
        experiments: keys of `EXPERIMENTS`.
        on_check: called with each check when it is complete.

    Raises:
        OutputExists: the folder exists already; nothing is written.
        ExperimentError, TestbedError, TtempcError: the scenario is invalid; nothing is written.
    """
    if folder is not None:
        refuse_existing(folder)
    checks: list[Check] = []
    for check in validate(bench(scenario), experiments):
        on_check(check)
        checks.append(check)
    report = ValidationReport(name, versions(), tuple(checks))
    if folder is not None:
        _write(report, dump(scenario), folder)
    return report


def _write(report: ValidationReport, scenario_toml: str, folder: Path) -> None:
    make_folder(folder)
    write_file(folder / "validation.json", report.to_json())
    pictures: list[Picture] = []
    for chart in (check.chart for check in report.checks if check.chart is not None):
        stem = re.sub(r"[^a-z0-9]+", "-", chart.title.lower()).strip("-")
        content = png(chart_figure(chart))
        pictures.append(Picture.of(stem, chart.title, content))
        write_file(folder / f"{stem}.png", content)
    page = environment().get_template("validation.html.j2")
    rows = [(check, figure_text(check)) for check in report.checks]
    tables = {"validation": report, "rows": rows, "counts": report.counts, "pictures": pictures}
    write_file(folder / "validation.html", page.render(scenario_toml=scenario_toml, **tables))


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


def chart_figure(chart: Chart) -> Figure:
    """Return a chart of half a page's width: measured lines coloured, laws black and dashed."""
    figure = Figure(figsize=(0.5 * PAGE_WIDTH_IN, 2.5), dpi=DPI, layout="constrained")
    axes = figure.subplots()
    colours = iter(_COLOURS)
    for line in chart.lines:
        if line.measured:
            marker = "o" if len(line.x) < _MAX_MARKERS else ""
            style = {"color": next(colours), "marker": marker, "markersize": 4.0}
        else:
            style = {"color": BLACK, "linestyle": (0, (4, 2))}
        axes.plot(line.x, line.y, linewidth=1.2, label=line.label, **style)
    dress(axes, chart.x_label, chart.y_label)
    axes.margins(x=0.03)
    legend(axes, len(chart.lines))
    return figure


def _finite(value: object) -> object:
    """Return a value of JSON; a number that is not finite is None."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
