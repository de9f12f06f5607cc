"""Report of a plant validation: card.json, card.html and its figures."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from matplotlib.figure import Figure

from ...testbed.inspection.check import Chart, Check
from ..figures import png
from ..figures.style import BLACK, BLUE, DPI, GREEN, PAGE_WIDTH_IN, RED, dress, legend
from ..output import make_folder, refuse_existing, write_file
from ..report.html import Picture, environment
from ..scenario.scenario import Scenario, dump
from .plant_validation import PlantValidation, figure_text, validate_plant

_COLOURS: Final = (BLUE, RED, GREEN)
_MAX_MARKERS: Final = 25  # lines with more points are drawn without markers


def write_plant_validation(
    name: str, scenario: Scenario, folder: Path, on_check: Callable[[Check], object]
) -> PlantValidation:
    """Inspect the plant of a scenario and write card.json, card.html and the figures to a folder.

    Args:
        name: of the scenario.
        scenario: whose plant is inspected.
        folder: to create.
        on_check: called with each check when it is complete.

    Raises:
        OutputExists: the folder exists already; nothing is written.
        ExperimentError, TestbedError, TtempcError: the scenario is invalid; nothing is written.
    """
    refuse_existing(folder)
    validation = validate_plant(name, scenario, on_check=on_check)
    make_folder(folder)
    write_file(folder / "card.json", validation.to_json())
    pictures = []
    for check in validation.checks:
        if check.chart is not None:
            content = png(chart_figure(check.chart))
            picture = Picture.of(_file_stem(check.chart), check.chart.title, content)
            write_file(folder / f"{picture.name}.png", content)
            pictures.append(picture)
    page = render_page(validation, dump(scenario), pictures)
    write_file(folder / "card.html", page)
    return validation


def render_page(
    validation: PlantValidation, scenario_toml: str, pictures: Sequence[Picture]
) -> str:
    """Return the text of `card.html`."""
    counts = Counter(check.verdict for check in validation.checks)
    return (
        environment()
        .get_template("card.html.j2")
        .render(
            validation=validation,
            counts=counts,
            rows=[(check, figure_text(check)) for check in validation.checks],
            pictures=pictures,
            scenario_toml=scenario_toml,
        )
    )


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


def _file_stem(chart: Chart) -> str:
    return re.sub(r"[^a-z0-9]+", "-", chart.title.lower()).strip("-")
