"""Figures of a run: labels with units, drawn data equal to the record's, size, reproducibility."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from PIL import Image
from proving_ground.experiments.pictures.figures import CAPTIONS, FIGURES, draw
from proving_ground.experiments.pictures.figures.export import WIDTHS_CM
from proving_ground.experiments.pictures.figures.magnified import magnification
from proving_ground.experiments.pictures.figures.style import figure_width
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.experiments.results.tracking_errors import QUANTITIES, tracking_errors
from proving_ground.testbed.recording.channels import (
    CONTROL,
    CORRIDOR,
    SOLVER,
    TIMING,
    TOOL,
    TUBE,
    TYRES,
)

from tests.records import eight, record, straight, table_of

MAX_BYTES = 300_000
HALF_WIDTH_M = 0.2


@pytest.fixture(scope="module")
def run():
    """A run of 100 s with noisy errors and a tube of constant width about zero error."""
    made_up = record(duration_s=100.0, cross=(0.05, -0.08), noise_m=0.03)
    time_s = made_up[CONTROL].time_s
    columns = {f"{name}_nominal": np.zeros(len(time_s)) for name in QUANTITIES}
    columns |= {f"{name}_half_width": np.full(len(time_s), HALF_WIDTH_M) for name in QUANTITIES}
    columns["margin"] = np.linspace(-1.0, 1.0, len(time_s))
    offsets = {"half_width_m": np.full(len(time_s), 0.1), "tractor_m": np.zeros(len(time_s))}
    tables = made_up.tables | {
        TUBE.topic: table_of(TUBE, time_s, columns),
        CORRIDOR.topic: table_of(CORRIDOR, time_s, offsets),
    }
    return replace(made_up, tables=tables)


def line(axes, label):
    """Return x and y (n, 2) of the first line with a label."""
    lines = {one.get_label(): one for one in reversed(axes.lines)}
    return lines[label].get_xydata()


def test_the_path_figure_shows_the_errors_of_both_bodies_enlarged_beside_the_line(run):
    """The distance of what is drawn from the line is the error, times the factor that is said."""
    (axes,) = FIGURES["path"](run).axes
    factor = float(re.search(r"([\d.]+) times as large", axes.get_xlabel())[1])
    assert factor > 1.0
    reference = line(axes, "reference")
    errors = tracking_errors(run)
    for body, error in errors.by_point.items():
        apart = np.hypot(*(line(axes, body) - reference).T)
        shown = np.isfinite(apart)
        np.testing.assert_array_equal(shown, errors.counted)
        np.testing.assert_allclose(apart[shown], factor * np.abs(error.cross_m[shown]))


def test_errors_as_large_as_the_path_are_not_enlarged():
    assert magnification(10.0, [np.array([20.0, np.nan])]) == 1.0
    assert magnification(0.0, [np.zeros(3)]) == 1.0


@pytest.mark.parametrize("error_m", [0.001, 0.0123, 0.04, 0.3])
def test_the_factor_is_round_and_an_error_takes_a_visible_share(error_m):
    factor = magnification(50.0, [np.full(10, error_m)])
    assert factor == 1.0 or f"{factor:e}"[0] in "125"
    assert factor * error_m <= 0.06 * 50.0
    assert factor == 1.0 or factor * error_m > 0.02 * 50.0


def written(axes):
    """Yield all texts of axes but the numbers at their ticks."""
    for one in axes:
        yield from (one.xaxis.label, one.yaxis.label, one.title, *one.texts)
        yield one._left_title
        if one.get_legend() is not None:
            yield from one.get_legend().get_texts()


@pytest.mark.parametrize("width_cm", [*WIDTHS_CM.values()])
@pytest.mark.parametrize("name", FIGURES)
def test_all_text_is_inside_the_column(name, width_cm, run):
    """Legends, labels, titles and notes end where the page does."""
    with figure_width(width_cm / 2.54):
        figure = FIGURES[name](run)
    FigureCanvasAgg(figure).draw()
    page = figure.bbox
    for text in filter(Text.get_text, [*figure.texts, *written(figure.axes)]):
        box = text.get_window_extent()
        assert page.x0 - 1.0 <= box.x0, text.get_text()
        assert box.x1 <= page.x1 + 1.0, text.get_text()


def test_close_ups_are_centred_where_the_tractor_was_farthest(run):
    errors = tracking_errors(run)
    for axes in FIGURES["zoom"](run).axes:
        dots = [line.get_xydata()[0] for line in axes.lines if line.get_marker() == "o"]
        centre = np.mean([axes.get_xlim(), axes.get_ylim()], axis=1)
        np.testing.assert_allclose(dots[0], centre, atol=1e-9)
        distance = np.hypot(*(dots[1] - dots[0]))
        part = errors.curved if "curve" in axes.get_title(loc="left") else ~errors.curved
        largest = errors.tractor.euclidean_m[part & errors.counted].max()
        assert distance == pytest.approx(largest)


def test_the_error_figure_shows_the_distance_to_the_reference(run):
    errors = tracking_errors(run)
    for axes, body in zip(FIGURES["error"](run).axes, ("tractor", "trailer"), strict=True):
        time_s, error_cm = axes.lines[0].get_xydata().T
        np.testing.assert_array_equal(time_s, errors.time_s)
        np.testing.assert_allclose(error_cm, 100 * getattr(errors, body).euclidean_m)


def test_control_signals_show_every_action_of_every_input(run):
    figure = FIGURES["signals"](run)
    control = run[CONTROL]
    inputs = (("delta_t_rad", 180.0 / np.pi), ("delta_i_rad", 180.0 / np.pi), ("hp", 100.0))
    for axes, (name, factor) in zip(figure.axes, inputs, strict=True):
        assert len(axes.lines) in (
            6,
            7,
        )  # two bounds; the sum where it is cut
        for label, action in (("feedback", "feedback"), ("total, as sent", "command")):
            time_s, values = line(axes, label).T
            np.testing.assert_array_equal(time_s, control.time_s)
            np.testing.assert_allclose(values, factor * control[f"{name}_{action}"])
        low, high = (one.get_ydata() for one in axes.lines[-2:])
        np.testing.assert_allclose(low, factor * control[f"{name}_min"])
        np.testing.assert_allclose(high, factor * control[f"{name}_max"])


def test_the_tyre_figure_shows_means_over_a_second_of_each_wheel(run):
    slip, angle, load = FIGURES["tyres"](run).axes
    tyres = run[TYRES]
    for axes, label, field, factor in (
        (slip, "rear left", "rear_left_slip", 100.0),
        (angle, "trailer right", "trailer_right_slip_angle_rad", 180.0 / np.pi),
        (load, "front left", "front_left_load_n", 1e-3),
    ):
        second = np.floor(tyres.time_s) == 20.0
        times_s, means = line(axes, label).T
        drawn = means[np.floor(times_s) == 20.0]
        assert drawn == pytest.approx([factor * tyres[field][second].mean()])


def test_the_timing_figure_counts_every_control_period(run):
    titles = {axes.get_title(loc="left"): axes for axes in FIGURES["timing"](run).axes}
    axes = titles["control step"]
    time_us = run[TIMING]["control_step_us"]
    assert sum(patch.get_height() for patch in axes.patches) == len(time_us)
    median, p99 = (one.get_xdata()[0] for one in axes.lines)
    assert (median, p99) == pytest.approx(tuple(np.percentile(time_us, [50.0, 99.0])))


@pytest.mark.parametrize(
    ("status", "text"),
    [
        ([0.0, 0.0, 1.0], "1 of 3 ticks needed the solver"),
        ([0.0, 0.0, 0.0], "0 of 3 ticks needed the solver"),
        ([np.nan] * 3, "the controller solves no QP"),
    ],
)
def test_the_timing_figure_says_how_many_ticks_needed_the_solver(run, status, text):
    table = table_of(SOLVER, np.arange(3.0), {"status": np.array(status)})
    with_qps = replace(run, tables={**run.tables, SOLVER.topic: table})
    axes = FIGURES["timing"](with_qps).axes
    titles = [" ".join(each.get_title(loc="left").split()) for each in axes]  # lines are broken
    assert f"QP solve: {text}" in titles


def test_the_tube_figure_shows_offsets_to_the_left_and_the_margin(run):
    *bodies, margin = FIGURES["tube"](run).axes
    errors = tracking_errors(run)
    for axes, body in zip(bodies, ("tractor", "trailer"), strict=True):
        time_s, offset_cm = line(axes, body).T
        rows = np.searchsorted(errors.time_s, time_s)
        np.testing.assert_array_equal(errors.time_s[rows], time_s)
        np.testing.assert_allclose(offset_cm, 100 * getattr(errors, body).cross_m[rows])
        assert time_s[0] == pytest.approx(8.0)
        band = next(each for each in axes.collections if each.get_label() == "tube")
        y = band.get_paths()[0].vertices[:, 1]
        assert (y.min(), y.max()) == pytest.approx((-100 * HALF_WIDTH_M, 100 * HALF_WIDTH_M))
    facts = RunFacts("", "grass", "made-up", 0, "completed", None, {}, None)
    counted = summarise(run, facts).tube  # one containment: that of summary and console
    assert margin.lines[0].get_ydata().min() == counted.margin_min
    (text,) = margin.texts
    inside = f"{100.0 * counted.contained_fraction:.2f} % of the ticks"
    assert text.get_text() == f"both true axle points inside at {inside}"


@pytest.mark.parametrize(
    ("curvature", "duration_s", "text"),
    [(straight, 20.0, "mean on straights"), (eight, 4.0, "shorter than"), (eight, 0.0, "shorter")],
)
def test_a_run_without_curves_or_counted_time_has_figures_with_a_note(curvature, duration_s, text):
    short = record(curvature, duration_s)
    assert set(draw(short)) == set(FIGURES) - {"tube", "corridor"}
    assert text in FIGURES["error"](short).axes[0].texts[0].get_text()


def test_figures_are_small_png_files_as_wide_as_a_page():
    pictures = draw(record(duration_s=273.0, noise_m=0.03))
    assert set(CAPTIONS) == set(FIGURES) == {*pictures, "tube", "corridor"}
    for content in pictures.values():
        assert len(content) < MAX_BYTES
        assert Image.open(io.BytesIO(content)).width == 792


def test_the_tool_is_drawn_where_it_works():
    run = record(tool=(0.03, 0.04))
    figure = FIGURES["error"](run)
    drawn = figure.axes[2].lines[0].get_ydata()
    works = run[TOOL]["lowered"] == 1.0
    assert np.array_equal(np.isfinite(drawn), works)
    np.testing.assert_allclose(drawn[works], 5.0)
    beside = line(FIGURES["path"](run).axes[0], "tool")
    errors = tracking_errors(run)
    assert np.array_equal(np.isfinite(beside[:, 0]), works & errors.counted)
    assert len(FIGURES["error"](record()).axes) == 2
