"""The figures: drawn from any record, axes labelled with units, light, and the same every time."""

import io

import pytest
from PIL import Image

from proving_ground.experiments.figures import CAPTIONS, FIGURES, draw, png
from tests.records import eight, record, straight

MAX_BYTES = 300_000


@pytest.mark.parametrize("name", FIGURES)
def test_axes_are_labelled_with_units(name):
    figure = FIGURES[name](record(duration_s=100.0, noise_m=0.03))
    shown_x = {axes.get_xlabel() for axes in figure.axes} - {""}
    assert shown_x
    for axes in figure.axes:
        label = axes.get_ylabel()
        assert label
        assert "[" in label or label == "control periods"
    assert all("[" in label for label in shown_x)


@pytest.mark.parametrize(
    ("curvature", "duration_s"),
    [(straight, 20.0), (eight, 4.0), (eight, 0.0)],
    ids=["no curve", "within the start-up", "over at once"],
)
def test_every_run_has_figures(curvature, duration_s):
    for content in draw(record(curvature, duration_s)).values():
        assert Image.open(io.BytesIO(content)).format == "PNG"


def test_figures_are_light_and_as_wide_as_a_page():
    pictures = draw(record(duration_s=273.0, noise_m=0.03))
    assert set(pictures) == set(FIGURES) - {"tube"}
    assert set(CAPTIONS) == set(FIGURES)
    for content in pictures.values():
        assert len(content) < MAX_BYTES
        assert Image.open(io.BytesIO(content)).width == 792


def test_the_same_record_gives_the_same_picture():
    run = record(duration_s=30.0, noise_m=0.03)
    assert png(FIGURES["error"](run)) == png(FIGURES["error"](run))


def test_control_signals_show_every_action_of_every_input():
    figure = FIGURES["signals"](record())
    assert len(figure.axes) == 3
    for axes in figure.axes:
        assert len(axes.lines) == 7  # three actions, their sum, what was sent, two bounds
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == [
        *("feedforward", "feedback", "robust"),
        *("total, before limits", "total, as sent", "bounds"),
    ]


def test_mean_errors_are_written_into_the_figure():
    figure = FIGURES["error"](record(cross=(0.123, 0.045), duration_s=100.0))
    words = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert words == [
        "mean on straights 12.3 cm, on curves 12.3 cm",
        "mean on straights 4.5 cm, on curves 4.5 cm",
    ]
