"""Drawn faults: laws of the draws, what counts as notice, shares of made-up rows, one drive."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from proving_ground.experiments.papers.alarms import Begun
from proving_ground.experiments.papers.fault_draws import (
    CAUSES,
    CLASSES,
    FIELDS,
    SENSORS,
    Label,
    drawn,
    drives_of,
    nested,
    strata,
    studies,
)
from proving_ground.experiments.papers.studies.false_alarms import fields, healthy_studies
from proving_ground.experiments.papers.studies.faults import (
    drawn_table,
    drive_fault,
    fault_tables,
    first_act,
    is_named,
)
from proving_ground.experiments.results.statistics import proportion
from proving_ground.experiments.studies.sweep.folder import Origin, SweepFolder
from proving_ground.experiments.studies.sweep.plan import SweepPlan
from proving_ground.experiments.studies.sweep.study import Study, VariantAxis
from proving_ground.experiments.studies.sweep.sweep import sweep_job

from ttempc.detectors.interface import Reaction


def test_strata_have_one_number_in_each_part():
    shares = strata(40, np.random.default_rng(1))
    assert sorted(int(40.0 * share) for share in shares) == [*range(40)]


def test_a_draw_stays_in_its_range_and_takes_each_entry_of_a_list_equally_often():
    shares = strata(60, np.random.default_rng(2))
    rates = [drawn({"low": 0.01, "high": 1.0}, share) for share in shares]
    assert min(rates) >= 0.01
    assert max(rates) <= 1.0
    assert np.median(rates) == pytest.approx(0.1, rel=0.1)  # log-uniform
    assert {*Counter(drawn(["a", "b", "c"], share) for share in shares).values()} == {20}
    angles = [drawn({"low": -180.0, "high": 180.0}, share) for share in shares]
    assert np.mean(angles) == pytest.approx(0.0, abs=3.0)


@pytest.mark.parametrize("name", CLASSES)
def test_drives_of_a_class_are_spread_over_sensors_and_fields(name):
    drives = [*drives_of(name, 5)]
    assert len(drives) == CLASSES[name]["drives"]
    wanted = CLASSES[name].get("sensors", [*SENSORS])
    per_entry = len(drives) / len(wanted)
    for sensors, entries in Counter(wanted).items():
        count = sum(drive.sensors == sensors for drive in drives)
        assert abs(count - entries * per_entry) < 2.0
    fields_driven = Counter(drive.field for drive in drives)
    assert max(fields_driven.values()) - min(fields_driven.values(), default=0) <= 2
    assert CLASSES[name]["causes"] in CAUSES


def test_a_seed_draws_the_same_drives_and_another_one_others():
    assert studies(7, 0.1) == studies(7, 0.1)
    assert studies(7, 0.1) != studies(8, 0.1)
    own = studies(7, 0.1)
    assert len({study.seeds for study in own.values()}) == len(own)  # ground of each its own


def test_the_released_study_is_large_and_its_command_has_the_seed():
    table = drawn_table(123)
    assert sum(SweepPlan(name, own).size for name, own in table.studies.items()) >= 600
    assert table.anew is not None
    assert table.anew(124).seed == 124


def test_healthy_drives_cover_every_field_and_share_no_seed():
    own = healthy_studies(9)
    seeds = [seed for study in own.values() for seed in study.point_seeds]
    assert len(seeds) == len({*seeds})
    assert {name.rpartition(", ")[0] for name in own} == {*fields()}


def test_a_report_is_no_notice_and_what_came_before_the_fault_neither():
    report = Begun(31.0, "innovations of the GNSS", Reaction.WARN, acts=False)
    before = Begun(29.0, "drift", Reaction.SLOW, acts=True)
    after = Begun(33.0, "drift", Reaction.SLOW, acts=True)
    assert first_act([before, report, after], 30.0) == after
    assert first_act([before, report], 30.0) is None


def test_the_cause_is_right_where_an_act_within_a_second_of_the_first_names_it():
    first = Begun(31.0, "motion", Reaction.STOP_ON_PATH, acts=True)
    second = Begun(31.6, "velocity, second limit", Reaction.STOP_ON_PATH, acts=True)
    report = Begun(31.2, "innovations of the hitch angle", Reaction.WARN, acts=False)
    later = Begun(34.0, "clock", Reaction.SLOW, acts=True)
    begun = [first, report, second, later]
    assert is_named(begun, 31.0, CAUSES["gnss"])
    assert not is_named(begun, 31.0, CAUSES["angle"])
    assert not is_named(begun, 31.0, CAUSES["time"])


def made_up(of, noticed_s, off_m, worst_m, status="completed", named=True):
    label = str(Label(of, "velocity, IMU", "0"))
    return {
        "drive": label,
        "scenario": "grass",
        "status": status,
        "noticed_s": noticed_s,
        "cause": "drift" if noticed_s is not None else "",
        "named": named,
        "off_at_notice_m": off_m,
        "worst_m": worst_m,
    }


def test_shares_count_drives_that_were_noticed_in_time():
    rows = [
        made_up("stairs", 4.0, 0.2, 0.7, "stopped"),
        made_up("stairs", 9.0, 0.8, 0.9, "stopped", named=False),
        made_up("stairs", None, 0.3, 0.3),
        made_up("stairs", None, 2.0, 2.0, "lost"),
    ]
    text = fault_tables(pd.DataFrame(rows))
    line = next(line for line in text.splitlines() if line.startswith("| stairs"))
    cells = [cell.strip() for cell in line.strip("|").split("|")]
    low, high = proportion(1, 4).ends
    assert cells[1:4] == ["4", f"25 % ({100 * low:.0f} to {100 * high:.0f})", "1"]
    assert cells[4].startswith("50 %")  # of two that were noticed
    assert cells[-1] == "1"  # lost, 2 m off
    assert "stairs as *drift*: 1" in text


def job_of(field, of, changes):
    """Return the job of a drive with changes by dotted keys."""
    axis = VariantAxis(
        kind="variants", name="drive", values={str(Label(of, "IMU", "0")): nested(changes)}
    )
    plan = SweepPlan("made-up", Study(scenario=field, seeds=(1,), axis=(axis,)))
    return sweep_job(plan, SweepFolder(Path(), Origin.here("", plan.size)), 0)


def test_a_jump_is_noticed_at_once_and_named_and_a_controller_of_nan_stops_the_vehicle():
    jump = {"kind": "gnss_jump", "start_s": 12.0, "offset_m": 2.0}
    row = drive_fault(job_of("grass", "jump", {"faults": [jump], **FIELDS["grass"]["set"]}))
    assert row["noticed_s"] < 2.0
    assert row["named"]
    assert row["off_at_notice_m"] < 0.5
    failing = CLASSES["controller answers NaN"]["set"] | {"controller.options.start_s": 12.0}
    row = drive_fault(job_of("grass", "controller answers NaN", failing))
    assert row["status"] == "stopped"
    assert "no finite command" in str(row["failure"])
