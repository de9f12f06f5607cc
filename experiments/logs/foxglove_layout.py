"""Foxglove layout shipped with the project, `foxglove-layout.json` beside this module.

Run `python -m experiments.logs.foxglove_layout` after a change of topics or fields. The format is
that of files exported by the Foxglove app: panels by name, and a binary tree of splits.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final

from proving_ground.testbed.recording import topics
from proving_ground.testbed.recording.channels import (
    CONTROL,
    SOLVER,
    STATE,
    TIMING,
    TRACKING,
    TYRES,
    Channel,
)
from proving_ground.testbed.truth import WHEELS

FILE: Final = Path(__file__).with_name("foxglove-layout.json")

_REFERENCE, _DRIVEN, _PREDICTED = "#f2c14e", "#4ea8f2", "#f25c54"
_LINES: Final = {
    topics.REFERENCE_PATH_TOPIC: _REFERENCE,
    topics.DRIVEN_TOPIC: _DRIVEN,
    topics.DRIVEN_TRAILER_TOPIC: _DRIVEN,
    topics.PREDICTED_PATH_TOPIC: _PREDICTED,
    topics.PREDICTED_TRAILER_PATH_TOPIC: _PREDICTED,
}
_ACTIONS: Final = ("feedforward", "feedback", "robust", "command", "min", "max")
_ERRORS: Final = ("x_t_e_m", "y_t_e_m", "x_i_e_m", "y_i_e_m")

Config = dict[str, Any]


def layout_text() -> str:
    """Return the content of the layout file: field, errors and inputs, sensors and costs."""
    left = {"3D!field": _field(), "RosOut!events": {"topicToRender": topics.EVENT_TOPIC}}
    middle = {
        "Plot!error": _plot("Estimated error [m]", TRACKING, _ERRORS),
        "Plot!front": _input("Front steering [rad]", "delta_t_rad"),
        "Plot!trailer": _input("Trailer steering [rad]", "delta_i_rad"),
        "Plot!hydrostat": _input("Hydrostat [fraction]", "hp"),
        "Plot!slip": _plot("Slip", TYRES, [f"{wheel}_slip" for wheel in WHEELS]),
    }
    right = {
        "map!gnss": {"followTopic": topics.GNSS_TOPIC},
        "Plot!load": _plot("Load [N]", TYRES, [f"{wheel}_load_n" for wheel in WHEELS]),
        "Plot!speed": _plot("Speed [m/s]", STATE, ("v_mps", "v_rim_mps")),
        "Plot!solver": _plot("QP", SOLVER, ("iterations", "accepted", "fallback")),
        "Plot!cost": _plot("Cost [us]", TIMING, TIMING.fields),
    }
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


def _input(title: str, name: str) -> Config:
    return _plot(title, CONTROL, [f"{name}_{part}" for part in _ACTIONS])


def _plot(title: str, channel: Channel, fields: tuple[str, ...] | list[str]) -> Config:
    """Return a plot of some fields of one channel over time."""
    return {
        "title": title,
        "paths": [
            {
                "value": f"{channel.topic}.{name}",
                "label": name,
                "enabled": True,
                "timestampMethod": "receiveTime",
            }
            for name in fields
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
        for topic, colour in _LINES.items()
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
