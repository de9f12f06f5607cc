"""PlotJuggler layout for logs: `python -m experiments.logs.plotjuggler_layout` writes it.

Elements and attributes are those that PlotJuggler 3 saves.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from .panels import PANELS, Panel

FILE: Final = Path(__file__).with_name("plotjuggler-layout.xml")
_TABS: Final = {
    "tracking": ("cross", "error", "front", "trailer", "hydrostat"),
    "vehicle": ("speed", "slip", "load"),
    "controller": ("estimated", "solver", "cost"),
}


def layout_text() -> str:
    """Return the content of the layout file: three tabs of plots one above the other."""
    root = Element("root")
    attributes = {"name": "Main Window", "parent": "main_window"}
    window = SubElement(root, "tabbed_widget", attributes)
    panels = {panel.name: panel for panel in PANELS}
    for name, parts in _TABS.items():
        tab = SubElement(window, "Tab", tab_name=name, containers="1")
        _add_plots(SubElement(tab, "Container"), [panels[part] for part in parts])
    SubElement(window, "currentTabIndex", index="0")
    SubElement(root, "use_relative_time_offset", enabled="1")
    indent(root, " ")
    return f"<?xml version='1.0' encoding='UTF-8'?>\n{tostring(root, encoding='unicode')}\n"


def _add_plots(container: Element, panels: Sequence[Panel]) -> None:
    count = len(panels)
    sizes = ";".join([f"{1.0 / count:.6f}"] * count)
    # "-" divides by horizontal lines, "|" by vertical ones.
    splitter = SubElement(container, "DockSplitter", orientation="-", count=str(count), sizes=sizes)
    for panel in panels:
        area = SubElement(splitter, "DockArea", name=panel.title)
        plot = SubElement(
            area, "plot", mode="TimeSeries", style="Lines", flip_x="false", flip_y="false"
        )
        SubElement(plot, "limitY")
        for series in panel.series:
            name = f"{series.channel.topic}/{series.field}"
            SubElement(plot, "curve", name=name, color=series.colour)


if __name__ == "__main__":
    FILE.write_text(layout_text(), encoding="utf-8")
