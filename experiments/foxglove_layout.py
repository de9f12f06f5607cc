"""Writes the layout for Foxglove that ships with the project, `experiments/foxglove-layout.json`.

Run with `python -m experiments.foxglove_layout` after topics or fields have changed; it takes the
extra `live`, whose classes know the format.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

from foxglove import layouts as fl

from testbed import topics
from testbed.channels import CONTROL, SOLVER, STATE, TIMING, TRACKING, TYRES, Channel
from testbed.truth import WHEELS

FILE: Final = Path(__file__).with_name("foxglove-layout.json")

_REFERENCE, _DRIVEN, _PREDICTED = "#f2c14e", "#4ea8f2", "#f25c54"


def layout() -> fl.Layout:
    """Return the layout: the scene beside errors, inputs with their bounds, slip and the log."""
    inputs = [
        _plot(
            title,
            CONTROL,
            *(
                f"{name}_{part}"
                for part in ("feedforward", "feedback", "robust", "command", "min", "max")
            ),
        )
        for title, name in (
            ("Front steering [rad]", "delta_t_rad"),
            ("Trailer steering [rad]", "delta_i_rad"),
            ("Hydrostat [fraction]", "hp"),
        )
    ]
    left = _split(
        "column",
        (3.0, _scene()),
        (1.0, fl.LogPanel(config=fl.LogConfig(topic_to_render=topics.EVENT_TOPIC), title="Events")),
    )
    right = _split(
        "column",
        (1.0, _plot("Believed error [m]", TRACKING, "x_t_e_m", "y_t_e_m", "x_i_e_m", "y_i_e_m")),
        *((1.0, panel) for panel in inputs),
        (1.0, _plot("Slip", TYRES, *(f"{wheel}_slip" for wheel in WHEELS))),
        (1.0, _plot("Load [N]", TYRES, *(f"{wheel}_load_n" for wheel in WHEELS))),
    )
    more = _split(
        "column",
        (1.0, fl.MapPanel(config=fl.MapConfig(follow_topic=topics.GNSS_TOPIC), title="GNSS")),
        (1.0, _plot("Speed [m/s]", STATE, "v_mps", "v_rim_mps")),
        (1.0, _plot("QP", SOLVER, "iterations", "accepted", "fallback")),
        (1.0, _plot("Cost [us]", TIMING, *TIMING.fields)),
    )
    return fl.Layout(content=_split("row", (5.0, left), (4.0, right), (3.0, more)))


def text() -> str:
    """Return the layout as the file holds it."""
    return json.dumps(json.loads(layout().to_json()), indent=1) + "\n"


def _split(direction: str, *parts: tuple[float, fl.Content]) -> fl.SplitContainer:
    items = [fl.SplitItem(proportion=share, content=content) for share, content in parts]
    return fl.SplitContainer(direction="row" if direction == "row" else "column", items=items)


def _plot(title: str, channel: Channel, *fields: str) -> fl.PlotPanel:
    """Return a plot of fields of one channel over the time of the log."""
    series = [fl.PlotSeries(value=f"{channel.topic}.{name}", label=name) for name in fields]
    return fl.PlotPanel(config=fl.PlotConfig(paths=series, show_legend=True), title=title)


def _scene() -> fl.ThreeDeePanel:
    lines = {
        topics.REFERENCE_PATH_TOPIC: _REFERENCE,
        topics.DRIVEN_TOPIC: _DRIVEN,
        topics.DRIVEN_TRAILER_TOPIC: _DRIVEN,
        topics.PREDICTED_PATH_TOPIC: _PREDICTED,
        topics.PREDICTED_TRAILER_PATH_TOPIC: _PREDICTED,
    }
    shown = {
        topic: fl.BaseRendererPosesTopicSettings(
            visible=True, type="line", line_width=0.08, gradient=(colour, colour)
        )
        for topic, colour in lines.items()
    }
    return fl.ThreeDeePanel(
        config=fl.ThreeDeeConfig(
            follow_tf="tractor",
            follow_mode="follow-position",
            camera_state=fl.ThreeDeeCameraState(distance=12.0, phi=60.0, theta_offset=40.0),
            topics={
                topics.SCENE_TOPIC: fl.BaseRendererSceneUpdateTopicSettings(visible=True),
                **shown,
            },
        ),
        title="Field",
    )


if __name__ == "__main__":
    FILE.write_text(text(), encoding="utf-8")
