"""Foxglove layout shipped with the project, `foxglove-layout.json` beside this module.

Run `python -m experiments.logs.foxglove_layout` after a change of topics or fields. The format is
that of files exported by the Foxglove app: panels by name, and a binary tree of splits.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from ...testbed.recording import topics
from .panels import PANELS, PATH_COLOURS, Panel

FILE: Final = Path(__file__).with_name("foxglove-layout.json")
_MIDDLE: Final = 5  # plots beside the field; the others stand at the right

Config = dict[str, Any]


def layout_text() -> str:
    """Return the content of the layout file: field, errors and inputs, sensors and costs."""
    left = {"3D!field": _field(), "RosOut!events": {"topicToRender": topics.EVENT_TOPIC}}
    plots = [(f"Plot!{panel.name}", _plot(panel)) for panel in PANELS]
    middle = dict(plots[:_MIDDLE])
    right = {"map!gnss": {"followTopic": topics.GNSS_TOPIC}, **dict(plots[_MIDDLE:])}
    columns = [
        _split("column", list(left), 75.0),
        _split("column", list(middle)),
        _split("column", list(right)),
    ]
    layout = {
        "configById": {**left, **middle, **right},
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _split("row", columns, 42.0),
    }
    return json.dumps(layout, indent=1) + "\n"


def _split(direction: str, parts: list[Any], first_percent: float | None = None) -> Any:  # noqa: ANN401 - a tree of JSON
    """Return the tree of the parts side by side, all but the first in equal shares."""
    if len(parts) == 1:
        return parts[0]
    return {
        "direction": direction,
        "first": parts[0],
        "second": _split(direction, parts[1:]),
        "splitPercentage": 100.0 / len(parts) if first_percent is None else first_percent,
    }


def _plot(panel: Panel) -> Config:
    return {
        "title": panel.title,
        "paths": [
            {
                "value": f"{series.channel.topic}.{series.field}",
                "label": series.field,
                "color": series.colour,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for series in panel.series
        ],
        "showLegend": True,
        "legendDisplay": "floating",
        "showXAxisLabels": True,
        "showYAxisLabels": True,
        "isSynced": True,
        "xAxisVal": "timestamp",
    }


def _field() -> Config:
    lines = {
        topic: {"visible": True, "type": "line", "lineWidth": 0.08, "gradient": [colour, colour]}
        for topic, colour in PATH_COLOURS.items()
    }
    return {
        "title": "Field",
        "cameraState": {
            "perspective": True,
            "distance": 12,
            "phi": 60,
            "thetaOffset": 40,
            "target": [0, 0, 0],
            "targetOffset": [0, 0, 0],
            "targetOrientation": [0, 0, 0, 1],
            "fovy": 45,
            "near": 0.1,
            "far": 500,
        },
        "followMode": "follow-position",
        "followTf": "tractor",
        "scene": {"transforms": {"visible": False}},
        "topics": {topics.SCENE_TOPIC: {"visible": True}, **lines},
    }


if __name__ == "__main__":
    FILE.write_text(layout_text(), encoding="utf-8")
