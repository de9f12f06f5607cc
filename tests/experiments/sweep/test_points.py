"""Runs at given points: order, refusals, rows that are kept."""

import pytest
from proving_ground.experiments.errors import InvalidStudy, SweepRefused
from proving_ground.experiments.sweep import points as points_module
from proving_ground.experiments.sweep.engine import engine
from proving_ground.experiments.sweep.points import drive_points
from proving_ground.experiments.sweep.row import no_figures

SETTINGS = {"path": {"kind": "straight", "length_m": 2.0}, "controller": {"name": "pid"}}
KPA = "soil.cone_index_kpa"


@pytest.fixture
def driven(monkeypatch):
    """Return the list of jobs that are driven, whose rows come in reverse order."""
    jobs = []

    def rows_of(engine, planned, work=None):
        for job in reversed([*planned]):
            jobs.append(job)
            yield job.row("completed", None, no_figures(), 0.1)

    monkeypatch.setattr(points_module, "imap_rows", rows_of)
    return jobs


def drive(points, **options):
    with engine(workers=0) as here:
        return drive_points("grass", points, here, settings=SETTINGS, **options)


def test_rows_come_in_the_order_of_points_and_seeds(driven):
    rows = drive([{KPA: 900.0}, {KPA: 300.0}, {KPA: 600.0}], seeds=(7, 5))
    assert [[row[KPA] for row in one] for one in rows] == [[900.0] * 2, [300.0] * 2, [600.0] * 2]
    assert [[row["seed"] for row in one] for one in rows] == [[7, 5]] * 3
    assert all(job.scenario.controller.name == "pid" for job in driven)


def test_a_refused_point_has_no_rows(driven):
    rows = drive([{KPA: 300.0}, {KPA: -1.0}])
    assert [len(one) for one in rows] == [1, 0]
    with pytest.raises(InvalidStudy, match="cone_index_kpa"):
        drive([{KPA: -1.0}])


@pytest.mark.parametrize("points", [[], [{}], [{KPA: 300.0}, {"terrain.slope_rad": 0.1}]])
def test_points_of_different_keys_are_refused(points):
    with pytest.raises(InvalidStudy, match="the same keys"):
        drive(points)


def test_kept_rows_are_not_driven_again(tmp_path):
    points = [{KPA: 300.0}, {KPA: 900.0}]
    rows = drive(points, folder=tmp_path / "kept")
    assert drive(points, folder=tmp_path / "kept") == rows  # wall-clock times among them
    (first,), (second,) = drive(points[::-1], folder=tmp_path / "kept")
    same = ("run_id", "wall_s")
    assert [[row[key] for key in same] for row in (second, first)] == [
        [row[key] for key in same] for (row,) in rows
    ]
    with pytest.raises(SweepRefused):
        drive(points[:1], folder=tmp_path / "kept")
