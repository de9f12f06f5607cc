"""Summary of a run: closed forms, invariance under motions of the map, keys of summary.json."""

import json
import math
import re
from dataclasses import asdict, replace

import numpy as np
import pytest
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.experiments.results.table import (
    WIDTH,
    centimetres,
    format_run,
)
from proving_ground.testbed.recording.channels import CONTROL, SOLVER, STATE
from proving_ground.testbed.recording.record import REACTION, REACTION_ENDED, Event, Record

from tests.records import circle, eight, record, straight, table_of

FACTS = RunFacts("0", "made-up", "none", 1, "completed", None, {"ttempc": "0"}, "log.mcap")
KEYS = (
    "mean_euclidean_m rms_m p95_m max_m along_mean_m along_sd_m cross_mean_m cross_sd_m cross_p95_m"
)
ERROR_KEYS = KEYS.split()


def tracking(run: Record):
    return summarise(run, FACTS).tracking


def with_table(run: Record, table) -> Record:
    return replace(run, tables={**run.tables, table.channel.topic: table})


def test_a_constant_error_is_its_own_statistic():
    for curvature, none in ((straight, "curve"), (circle, "straight"), (eight, "")):
        run = tracking(record(curvature, along=(-0.3, 0.06), cross=(0.4, -0.08)))
        for where in ("straight", "curve", "all"):
            bodies = getattr(run, where)
            for error, along, cross in ((bodies.tractor, -0.3, 0.4), (bodies.trailer, 0.06, -0.08)):
                distance = math.hypot(along, cross)
                expected = dict.fromkeys(ERROR_KEYS, distance)
                expected |= {
                    "along_mean_m": along,
                    "cross_mean_m": cross,
                    "cross_p95_m": abs(cross),
                }
                expected |= {"along_sd_m": 0.0, "cross_sd_m": 0.0}
                if where == none:
                    expected = dict.fromkeys(ERROR_KEYS)
                assert asdict(error) == pytest.approx(expected, abs=1e-9)


def test_qps_are_counted_by_who_answered_them():
    """Ten ticks: no QP, six in closed form, one solved, one with soft bounds, one rejected."""
    run = record()
    columns = {
        "status": np.array([math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 2.0, 4.0]),
        "accepted": np.array([math.nan, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0]),
        "iterations": np.array([math.nan, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 9.0, 14.0, 250.0]),
        "primal_residual": np.array([math.nan, *np.zeros(6), 1e-15, 3e-15, 1.0]),
        "dual_residual": np.array([math.nan, *np.zeros(6), 2e-13, 1e-13, 1.0]),
    }
    solver = summarise(with_table(run, table_of(SOLVER, np.arange(10.0), columns)), FACTS).solver
    assert (solver.ticks, solver.needed_solver, solver.soft, solver.rejected) == (9, 3, 1, 1)
    assert solver.iterations_max == 250
    assert (solver.primal_residual_max, solver.dual_residual_max) == (3e-15, 2e-13)
    assert summarise(run, FACTS).solver is None


def test_errors_are_invariant_to_translation_and_rotation_of_the_map():
    original = asdict(tracking(record(noise_m=0.1)))
    moved = asdict(tracking(record(noise_m=0.1, turned=2.2, moved=(30.0, -700.0))))
    for where, bodies in original.items():
        for body, error in bodies.items():
            assert moved[where][body] == pytest.approx(error, abs=1e-9)


def test_a_mirrored_run_has_the_opposite_cross_track_error():
    run, mirrored = (
        tracking(record(cross=(0.2, 0.1), noise_m=0.05, mirrored=mirrored)).all
        for mirrored in (False, True)
    )
    for body in ("tractor", "trailer"):
        error, other = asdict(getattr(run, body)), asdict(getattr(mirrored, body))
        error["cross_mean_m"] = -error["cross_mean_m"]
        assert other == pytest.approx(error, abs=1e-9)


def test_the_start_up_does_not_count():
    run = record(cross=(0.1, 0.1))
    values = run[STATE].values.copy()
    values[run[STATE].time_s < 8.0] += 5.0
    wild = with_table(run, replace(run[STATE], values=values))
    assert tracking(wild) == tracking(run)


def test_a_final_standstill_counts_where_nothing_has_stopped_the_vehicle_alone():
    """A vehicle stands from 40 s on, 3 m aside; the supervisor has stopped it at 38 s."""

    def summary(*texts):
        events = tuple(Event(time_s, "warning", text) for time_s, text in texts)
        run = record(cross=(0.1, 0.1), events=events, tool=(0.0, 0.1))
        table, stands = run[STATE], run[STATE].time_s >= 40.0
        values = table.values.copy()
        values[:, table.channel.fields.index("v_mps")] = np.where(stands, 0.01, 1.0)
        values[stands, table.channel.fields.index("x_t_m")] += 3.0
        return summarise(with_table(run, replace(table, values=values)), FACTS)

    stop, end = (38.0, f"{REACTION}stopped"), (39.0, REACTION_ENDED)
    for texts in (
        (stop,),
        (stop, end, (39.5, stop[1])),
        ((30.0, f"{REACTION}cut"), (30.2, REACTION_ENDED), stop),
    ):
        assert summary(*texts).tracking.all.tractor.max_m == pytest.approx(0.1)
    for texts in ((), (stop, end)):
        assert summary(*texts).tracking.all.tractor.max_m > 2.9


def test_the_estimation_error_is_taken_at_the_times_of_the_estimates():
    estimation = summarise(record(estimate_off=(0.03, -0.04)), FACTS).estimation
    assert estimation.tractor.mean_euclidean_m == pytest.approx(0.03)
    assert estimation.trailer.mean_euclidean_m == pytest.approx(0.04)


def test_a_command_counts_as_saturated_at_its_bound_or_where_a_limit_changed_it():
    names = ("command", "min", "max", "limited")
    commands = {"delta_t_rad": (0.6, 0.1, 0.2, 0.3), "delta_i_rad": (0.0,) * 4, "hp": (0.0,) * 4}
    limited = {"delta_t_rad": (0.0, 1.0, 0.0, 0.0), "delta_i_rad": (0.0,) * 4, "hp": (0.0,) * 4}
    columns = {}
    for name, command in commands.items():
        low = 0.0 if name == "hp" else -0.6
        for part, values in zip(names, (command, [low] * 4, [0.6] * 4, limited[name]), strict=True):
            columns[f"{name}_{part}"] = np.array(values)
    run = with_table(record(), table_of(CONTROL, 0.2 * np.arange(4), columns))
    inputs = summarise(run, FACTS).inputs
    assert inputs.delta_t.saturated_fraction == 0.5
    assert inputs.delta_i.saturated_fraction == 0.0
    assert inputs.hp.saturated_fraction == 1.0
    steps = np.array([-0.5, 0.1, 0.1]) / 0.2
    assert inputs.delta_t.rms_rate == pytest.approx(math.sqrt(np.mean(steps**2)))


def test_a_summary_is_json():
    def unknown(word):
        raise AssertionError(f"{word} is no JSON")

    summary = json.loads(summarise(record(), FACTS).to_json(), parse_constant=unknown)
    assert [*summary["tracking"]["all"]["trailer"]] == ERROR_KEYS


def test_a_tool_counts_while_it_is_lowered():
    """A minute, lowered in its first half, with draft 900 N and 1 N more every second."""
    summary = summarise(record(tool=(0.05, -0.12), turned=0.7), FACTS)
    for error in (summary.tracking.straight.tool, summary.tracking.all.tool):
        assert error is not None
        assert error.mean_euclidean_m == pytest.approx(0.13, abs=1e-9)
        assert error.along_mean_m == pytest.approx(0.05, abs=1e-9)
        assert error.cross_p95_m == pytest.approx(0.12, abs=1e-9)
    statistics = summary.implement
    assert statistics is not None
    assert statistics.depth_mean_m == pytest.approx(0.05)
    assert statistics.side_p95_n == pytest.approx(50.0)
    assert statistics.draft_mean_n == pytest.approx(0.5 * (908.0 + 930.0), abs=0.1)
    assert statistics.draft_p95_n == pytest.approx(908.0 + 0.95 * 22.0, abs=0.1)
    assert list(summary.tracking.all.by_point) == ["tool", "trailer", "tractor"]
    assert "Draft 919 N (mean)" in format_run(summary)


def test_a_run_that_ended_at_once_has_a_summary_and_a_table():
    facts = replace(FACTS, status="lost", failure="roll-over " * 20)
    for duration_s in (0.0, 3.0):
        summary = summarise(record(duration_s=duration_s), facts)
        assert summary.tracking.all.tractor.mean_euclidean_m is None
        assert json.loads(summary.to_json())["duration_s"] == duration_s
        assert "roll-over" in format_run(summary)


def rows(text):
    """Numbers of a printed table by their first words."""
    lines = (re.split(r" {2,}", line.strip()) for line in text.splitlines())
    return {tuple(words[:2]): words[2:] for words in lines if len(words) > 5}


def test_the_table_tells_the_cross_track_error_of_the_working_point_first():
    summary = summarise(record(cross=(0.1, 0.05), noise_m=0.02), FACTS)
    text = format_run(summary)
    assert all(len(line) <= WIDTH for line in text.splitlines())
    (first, *_), shown = [key for key in rows(text) if key[0] == "whole path"], rows(text)
    assert first == ("whole path", "trailer")
    for body in ("trailer", "tractor"):
        error = getattr(summary.tracking.all, body)
        keys = ("cross_p95_m", "cross_sd_m", "cross_mean_m", "along_mean_m", "along_sd_m")
        expected = [centimetres(getattr(error, key)) for key in keys]
        assert shown["whole path", body] == expected


def test_an_entry_has_the_overshoot_and_the_way_of_each_point_in_closed_form():
    run = record(straight, duration_s=50.0)
    table = run[STATE]
    assert summarise(run, FACTS).entry is None
    way, values = table.time_s, table.values.copy()  # at 1 m/s
    decay = 1.5 * np.exp(-way / 4.0) * np.cos(0.5 * way)
    for name, share in (("y_t_m", 1.0), ("y_i_m", -0.5)):
        values[:, STATE.fields.index(name)] += share * decay
    entry = summarise(with_table(run, replace(table, values=values)), FACTS).entry
    # the extremes of exp(-s/4) cos(s/2) are where tan(s/2) = -1/2, half periods apart
    first = 2.0 * (math.pi - math.atan(0.5))
    lowest = 1.5 * math.exp(-first / 4.0) * abs(math.cos(0.5 * first))
    assert entry.tractor.overshoot_m == pytest.approx(lowest, abs=1e-3)
    assert entry.trailer.overshoot_m == pytest.approx(0.5 * lowest, abs=1e-3)
    x, y = (values[:, STATE.fields.index(name)] for name in ("x_t_m", "y_t_m"))
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    last = way[np.flatnonzero(np.abs(decay) > 0.1)[-1]]
    assert entry.tractor.settled_m == pytest.approx(np.interp(last, way, driven), abs=0.05)
    assert entry.trailer.settled_m < entry.tractor.settled_m
