"""Rays: analytic limit states, quantities, and a plant."""

import functools
import json

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import ExperimentError
from proving_ground.experiments.scenario.scenario import load, parse_overrides, read_scenario
from proving_ground.experiments.studies.search.quantities import (
    FAULTS,
    QUANTITIES,
    Parameter,
    Space,
    read_subject,
)
from proving_ground.experiments.studies.search.rays import (
    STEPS,
    Report,
    Specification,
    bisect,
    ends,
    search_rays,
)
from proving_ground.experiments.studies.sweep.engine import engine
from proving_ground.experiments.studies.sweep.results import rows
from proving_ground.experiments.studies.sweep.row import FIGURES, no_figures
from proving_ground.experiments.studies.sweep.sweep import points_plan

from tests.experiments.sweep_rows import ERROR

FORCE = Parameter(("force",), 0.0, 1.0, nominal=0.0)
DELAY = Parameter(("delay",), 0.0, 1.0, nominal=0.0)
STRENGTH = Parameter(("kpa",), 100.0, 1600.0, nominal=400.0, spacing="log")
PLACE = Parameter(("place",), 0.0, 1.0)
SPACE = Space((FORCE, DELAY, PLACE))


def test_rays_end_where_the_first_quantity_meets_its_bound():
    space = Space((FORCE, STRENGTH, PLACE))
    far = ends(space, 40, seed=3)
    way = np.abs(far - space.nominal)[:, :2] / [1.0, 0.5]
    np.testing.assert_allclose(way.max(axis=1), 1.0)
    assert far.min() >= 0.0
    assert far.max() <= 1.0
    assert sorted((far[:, 2] * 40).astype(int)) == [*range(40)]  # places fill their range
    assert (ends(space, 40, seed=3) == far).all()
    assert (ends(space, 40, seed=4) != far).any()


def test_bisection_brackets_the_limit_of_each_ray():
    limits = np.array([0.01, 0.3, 0.77, 1.0, 1.2])

    runs = [0] * len(limits)

    def evaluate(asked):
        for k, _ in asked:
            runs[k] += 1
        return ["fails" * int(severity >= limits[k]) for k, severity in asked]

    rays = bisect(evaluate, len(limits))
    for ray, limit in zip(rays[:4], limits, strict=False):
        assert ray.fails - ray.holds == pytest.approx(2.0**-STEPS)
        assert ray.holds < limit <= ray.fails
    assert (rays[4].holds, rays[4].fails) == (1.0, None)
    assert runs == [1 + STEPS] * 4 + [1]
    report = Report("s", "c", 1, None, tuple(rays), {}, {})
    assert [report.survived(x) for x in (0.0, 0.25, 0.5, 1.0)] == [5, 4, 3, 1]
    assert report.least == 0


def test_a_run_without_a_result_ends_its_ray():
    rays = bisect(lambda asked: [None if s < 1.0 else "fails" for _, s in asked], 2)
    assert [(ray.fails, ray.holds, ray.broken) for ray in rays] == [(1.0, 0.0, True)] * 2


def test_values_and_severities_of_a_space():
    for parameter in (FORCE, STRENGTH, PLACE):
        for position in (0.0, 0.3, 1.0):
            value = parameter.number(position)
            assert parameter.position(value) == pytest.approx(position, abs=1e-5)
    assert STRENGTH.number(0.5) == 400.0  # the geometric mean
    space = Space((FORCE, STRENGTH, PLACE))
    for place in (0.0, 0.9):
        assert space.severity(np.array([*space.nominal[:2], place])) == 0.0
        assert space.severity(np.array([1.0, 1.0, place])) == pytest.approx(1.0)
    assert space.severity(np.array([1.0, 0.5, 0.0])) == pytest.approx(np.sqrt(0.5))
    step = Parameter(("a", "b"), 0.0, 1.0, nominal=0.0, step=0.01)
    name = Parameter(("c",), 0.0, 2.0, nominal=1.0, names=("x", "y", "z"))
    assert Space((step, name)).changes(np.array([0.4567, 0.9])) == {"a": 0.46, "b": 0.46, "c": "z"}


def subject(*words, overrides=()):
    return read_subject(read_scenario("grass"), "grass", parse_overrides(overrides), words)


def test_every_name_makes_scenarios_over_its_whole_range():
    for word in (*FAULTS, *QUANTITIES):
        found = subject(word, overrides=["path.laps=1"])
        size = len(found.space.parameters)
        assert found.space.severity(found.space.nominal) == 0.0
        for corner in (np.zeros(size), np.ones(size)):
            changes = found.space.changes(corner)
            plan = points_plan(found.scenario, [changes], found.settings)
            assert plan.extent().runs == 1, word
            assert dict(plan.setting(changes).axes) == changes


def test_an_added_fault_stands_beside_those_of_the_scenario():
    own = "faults=[{kind='gnss_out', name='dark', start_s=3.0, duration_s=1.0}]"
    found = subject("gust", "faults.dark.duration_s=0.5:5", overrides=[own])
    plan = points_plan("grass", [found.space.changes(found.space.nominal)], found.settings)
    faults = plan[0].setting.scenario.faults
    assert [fault.label for fault in faults] == ["dark", "gust"]
    assert faults[0].duration_s == 1.0


def test_what_cannot_be_searched_is_refused():
    for words, message in (
        (("gusts",), "gust"),
        (("soil.cone_index_kpa=9:8",), "KEY=LOW:HIGH"),
        (("soil.cone_index_kpa=8:9:loose",), "KEY=LOW:HIGH:free"),
        (("soil.cone_index_kpa=100:200",), "from 100 to 200"),
        (("terrain.uphill_deg=0:360:free",), "severity"),
        (("faults.gust.force_n=0:1",), "names here: none"),
    ):
        with pytest.raises(ExperimentError, match=message):
            subject(*words)


def row(**changes):
    values = {"status": "completed", "failure": "", **no_figures()}
    return values | {name.replace("__", "."): value for name, value in changes.items()}


def test_what_counts_as_a_failure():
    specification = Specification.of(load("rows")[1], limit_m=0.2)
    assert not specification.failure(row(corridor__tool__max_m=0.09))
    for changes, reason in (
        ({"status": "lost", "failure": "roll-over"}, "roll-over"),
        ({"corridor__tool__max_m": 0.11}, "tool 0.110 m"),
        ({"corridor__hitch_outside_fraction": 0.01}, "hitch angle"),
        ({ERROR.replace(".", "__"): 0.3}, "0.300 m"),
    ):
        assert reason in specification.failure(row(**changes))


SHORT = ["path={kind='straight', length_m=10.0}", "controller.name=pid"]
WORDS = ["gust", "faults.gust.at_m=2:5:free"]


def drive(folder):
    found = subject(*WORDS, overrides=SHORT)
    with engine(0) as runs:
        search_rays(found, runs, 3, 2, folder=folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("search") / "rays"
    drive(folder)
    return folder


def results(folder):
    files = sorted(folder.glob("steps/*/results.jsonl"))
    return [row for file in files for row in sorted(rows(file), key=lambda row: row["run"])]


def test_the_file_of_a_worst_case_replays_its_failure(folder, tmp_path, capsys):
    """Every figure but those of wall-clock time is the same, and so is the identity of the run."""
    report = json.loads((folder / "rays.json").read_text())
    failing = [ray for ray in report["rays"] if ray["fails"] is not None]
    least = min(failing, key=lambda ray: ray["fails"])
    assert len(report["rays"]) == 2
    command = ["run", str(folder / "worst.toml"), "--seed", str(report["seed"]), "--json"]
    assert main([*command, "--out", str(tmp_path / "run")]) == 3
    summary = json.loads(capsys.readouterr().out)
    assert f"{summary['status']}: {summary['failure']}" == least["failure"]
    row = next(row for row in results(folder) if row["run_id"] == summary["run_id"])
    for name in FIGURES:
        if not name.startswith("timing."):
            found = functools.reduce(
                lambda table, key: table and table[key], name.split("."), summary
            )
            assert row[name] == found, name


def test_bad_input_is_one_line_before_any_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for words, message in (
        (["rays", "grass", "gusts"], "did you mean gust?"),
        (["limit", "grass", "gust"], "KEY=LOW:HIGH"),
        (["limit", "grass", "controller=0:1"], "KEY=LOW:HIGH"),
    ):
        assert main(["search", *words, "--workers", "0"]) == 2
        assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
