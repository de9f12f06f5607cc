"""Corridor of a scenario: judged by place, summarised, drawn, refused where it is impossible."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.pictures.figures import FIGURES, draw
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.experiments.results.table import WIDTH, format_run
from proving_ground.experiments.run.assembly import assemble, check
from proving_ground.experiments.run.corridor_judge import CorridorJudge
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import CORRIDOR, REFERENCE
from proving_ground.testbed.truth import Tool

from tests.records import record, table_of
from tests.testbed.truths import moments, truth
from ttempc.errors import InvalidTuning
from ttempc.reference.corridor import Corridor

FACTS = RunFacts("0", "made-up", "none", 1, "completed", None, {}, None)
BEHIND = 2.4
ONE = np.ones(1)


def reference_on_circle(radius, times):
    """Return rows of `REFERENCE` at 1 m/s counter-clockwise, the trailer `BEHIND` on the path."""
    rows = dict.fromkeys(REFERENCE.fields, np.zeros_like(times))
    for letter, s in (("t", times), ("i", times - BEHIND)):
        rows[f"x_{letter}_m"], rows[f"y_{letter}_m"] = (
            radius * np.sin(s / radius),
            radius - radius * np.cos(s / radius),
        )
        rows[f"psi_{letter}_rad"] = s / radius
    return np.column_stack([rows[name] for name in REFERENCE.fields])


def truth_at(s, left, radius, behind=None):
    """Return a truth at arc length `s`, its points `left` of their paths, lowered tool or none."""

    def place(s, radius, left):
        angle = s / radius
        return (radius - left) * math.sin(angle), radius - (radius - left) * math.cos(angle)

    tool = None
    if behind is not None:
        psi = (s - BEHIND) / radius
        x, y = place(s - BEHIND, radius, 0.0)
        x, y = x - behind * math.cos(psi), y - behind * math.sin(psi)
        outer = math.hypot(radius, behind)
        scale = (outer - left) / outer
        point = scale * x, radius + scale * (y - radius), 0.0
        tool = Tool(*point, behind, lowered=1.0, distance=s, depth=ONE, draft=ONE, side=ONE)
    points = (place(at, radius, left) for at in (s, s - BEHIND))
    tractor, trailer = ({"x": x, "y": y} for x, y in points)
    return truth(tractor, trailer, tool=tool)


def test_offsets_are_distances_from_the_path_whatever_the_time():
    """On a circle of 12 m, the vehicle 1.3 m behind its reference and 7 cm beside its path."""
    radius, times = 12.0, np.arange(0.0, 40.0, 0.04)
    rows = reference_on_circle(radius, times)
    corridor = Corridor(0.1, ((10.0, 20.0),), hitch_limit=0.5, tool_behind_m=0.6)
    judge = CorridorJudge(corridor, rows, times)
    for time in np.arange(4.0, 39.0, 0.7):
        driven = moments(truth_at(time - 1.3, 0.07, radius, behind=0.6))
        ((half_width, *offsets, limit),) = judge.rows(driven, rows)
        np.testing.assert_allclose(offsets, 0.07, atol=1e-4)
        assert limit == 0.5
        assert (half_width == 0.1) == (10.0 <= time - 1.3 < 20.0)
        assert half_width == 0.1 or math.isnan(half_width)


def with_offsets(columns, **made_up):
    run = record(**made_up)
    time_s = run.tables["/state"].time_s
    table = table_of(CORRIDOR, time_s, columns(time_s))
    return replace(run, tables={**run.tables, CORRIDOR.topic: table})


def test_the_fraction_counts_after_start_up_where_the_corridor_holds():
    """A ramp of the tractor from 0 to 0.2 m over a minute, the corridor from 20 s on."""

    def columns(time_s):
        return {
            "half_width_m": np.where(time_s >= 20.0, 0.1, np.nan),
            "tractor_m": -0.2 * time_s / 60.0,
            "trailer_m": np.full_like(time_s, 0.04),
        }

    run = with_offsets(columns)
    summary = summarise(run, FACTS)
    corridor = summary.corridor
    assert corridor.tractor.outside_fraction == pytest.approx(30.0 / 40.0, abs=1e-3)
    assert corridor.tractor.max_m == pytest.approx(0.2)
    assert (corridor.trailer.outside_fraction, corridor.trailer.max_m) == (0.0, 0.04)
    assert corridor.tool is None
    assert corridor.hitch_outside_fraction is None
    text = format_run(summary)
    assert "tractor 74.9" in text or "tractor 75.0" in text
    assert all(len(line) <= WIDTH for line in text.splitlines())
    figure = FIGURES["corridor"](run)
    lines = [axes.lines[0].get_ydata() for axes in figure.axes]
    np.testing.assert_allclose(lines[0], 100 * run[CORRIDOR]["tractor_m"])
    assert "corridor" in draw(run)


def test_impossible_corridors_are_refused_before_a_run():
    for override, error, named in (
        ("corridor={half_width_m=0}", InvalidScenario, "corridor.half_width_m"),
        ("corridor={}", InvalidScenario, "corridor.half_width_m"),
        ("corridor={half_width_m=0.1, along_m=[[5, 2]]}", InvalidScenario, "along_m"),
        ("corridor={half_width_m=0.1, hitch_limit_deg=2}", InvalidTuning, "hitch_limit: got 2.0"),
        ("controller.options.corridor_at_rest_m=[-0.1, 0]", InvalidScenario, "corridor_at_rest_m"),
    ):
        for build in (check, lambda scenario: assemble(scenario, 1)):
            with pytest.raises(error, match=named):
                build(load("grass", [override])[1])


SLOWER = (
    "path={kind='straight', length_m=36}",
    "corridor={half_width_m=0.1, along_m=[[15, 25]]}",
    "controller.options.corridor_at_rest_m=[0.05, 0.02]",
    "controller.options.corridor_per_speed_s=[0.1, 0.2]",
)


def test_the_reference_is_as_slow_as_the_controllers_half_widths_ask_for():
    """0.02 m + 0.2 s v of the trailer point fit into 0.1 m up to 0.4 m/s."""
    scenario = load("grass", SLOWER)[1]
    mission = scenario.mission()
    distance, speed, _ = mission.speed.travel(np.linspace(0.0, 60.0, 2001))
    held = (distance >= 15.0) & (distance < 25.0)
    assert speed[held].max() == pytest.approx(0.4)
    assert speed[distance < 5.0].min() == pytest.approx(1.0)
    (note,) = mission.notes
    assert "0.40 m/s" in note
    assert "cannot" not in note
    assert check(scenario) * scenario.control.period_s > 26.0 / 1.0 + 10.0 / 0.4
