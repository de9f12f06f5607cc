"""Search of the worst case: analytic limit states, quantities, and a plant."""

import functools
import json

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import ExperimentError
from proving_ground.experiments.scenario.scenario import load, parse_overrides, read_scenario
from proving_ground.experiments.search.quantities import (
    FAULTS,
    QUANTITIES,
    Parameter,
    Space,
    read_subject,
)
from proving_ground.experiments.search.worst_case import (
    Outcome,
    Specification,
    best,
    falsify,
    find_worst_case,
    milder,
)
from proving_ground.experiments.sweep.engine import engine
from proving_ground.experiments.sweep.results import rows
from proving_ground.experiments.sweep.row import FIGURES, no_figures
from proving_ground.experiments.sweep.sweep import points_plan

from tests.experiments.sweep_rows import ERROR

FORCE = Parameter(("force",), 0.0, 1.0, nominal=0.0)
DELAY = Parameter(("delay",), 0.0, 1.0, nominal=0.0)
STRENGTH = Parameter(("kpa",), 100.0, 1600.0, nominal=400.0, spacing="log")
PLACE = Parameter(("place",), 0.0, 1.0)
SPACE = Space((FORCE, DELAY, PLACE))


def evaluate(points):
    """Fail in a half plane of the severities, near one place."""
    distances = [0.6 + abs(place - 0.7) - (force + delay) / 2 for force, delay, place in points]
    return [Outcome("fails" if d <= 0.0 else "", min(max(d, 0.0), 1.0)) for d in distances]


def search(budget=150, seed=1, outcomes=evaluate):
    return falsify(SPACE, outcomes, budget, seed)


def test_the_least_severe_failure_is_found():
    """By symmetry it lies at force = delay = 0.6, place = 0.7, with severity 0.6."""
    for seed in (1, 2, 3):
        case = best(search(seed=seed))
        assert case.failed
        assert 0.6 - 1e-9 <= case.severity <= 0.66
        assert case.point == pytest.approx([0.6, 0.6, 0.7], abs=0.15)


def test_the_cases_follow_from_the_seed_and_the_budget_is_kept():
    for budget in (1, 10, 37, 150):
        cases, again = search(budget), search(budget)
        assert len(cases) == budget
        assert all((a.point == b.point).all() for a, b in zip(cases, again, strict=True))
    assert any((a.point != b.point).any() for a, b in zip(cases, search(seed=2), strict=True))


def test_without_a_failure_the_least_robust_case_is_best():
    def never(points):
        return [Outcome("", 0.2 + 0.8 * abs(place - 0.7)) for *_, place in points]

    cases = search(60, outcomes=never)
    assert not any(case.failed for case in cases)
    assert best(cases).point[2] == pytest.approx(0.7, abs=0.05)


def test_failures_are_simplified():
    """Where only the force matters, the delay of the least severe failure is nominal."""
    point = np.array([0.9, 0.5, 0.3])
    assert max(map(SPACE.severity, milder(SPACE, point))) < SPACE.severity(point)
    assert (milder(SPACE, point)[:, 2] == 0.3).all()
    assert milder(SPACE, point)[:2] == pytest.approx(np.array([[0.0, 0.5, 0.3], [0.9, 0.0, 0.3]]))
    by_force = best(
        search(60, outcomes=lambda ps: [Outcome("fails" * int(p[0] >= 0.5), 1.0) for p in ps])
    )
    assert by_force.point[1] == 0.0
    assert 0.5 <= by_force.point[0] < 0.53


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


def test_robustness_falls_from_1_at_the_nominal_run_to_0_at_a_limit():
    specification = Specification({"extremes.tilt_rad": 1.0, "extremes.fold_rad": 2.0})
    nominal = specification.shares(row(extremes__tilt_rad=0.1, extremes__fold_rad=1.0))
    for tilt, fold, robustness in (
        (0.1, 1.0, 1.0),
        (0.1, 1.5, 0.5),  # half way from 1 to 2
        (0.55, 1.5, 0.5),
        (0.91, 1.5, 0.1),
        (1.0, 1.0, 1e-9),
    ):
        figures = row(extremes__tilt_rad=tilt, extremes__fold_rad=fold)
        assert specification.judge(figures, nominal).robustness == pytest.approx(robustness)


def test_what_counts_as_a_failure():
    specification = Specification.of(load("rows")[1], limit_m=0.2)
    nominal = specification.shares(row())
    assert not specification.judge(row(corridor__tool__max_m=0.09), nominal).failure
    for changes, reason in (
        ({"status": "lost", "failure": "roll-over"}, "roll-over"),
        ({"corridor__tool__max_m": 0.11}, "tool 0.110 m"),
        ({"corridor__hitch_outside_fraction": 0.01}, "hitch angle"),
        ({ERROR.replace(".", "__"): 0.3}, "0.300 m"),
    ):
        assert reason in specification.judge(row(**changes), nominal).failure


SHORT = ["path={kind='straight', length_m=10.0}", "controller.name=pid"]
WORDS = ["gust", "faults.gust.at_m=2:5:free"]


def drive(folder):
    found = subject(*WORDS, overrides=SHORT)
    with engine(0) as runs:
        find_worst_case(found, runs, 3, 10, folder=folder)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("search") / "worst"
    drive(folder)
    return folder


def results(folder):
    files = sorted(folder.glob("generations/*/results.jsonl"))
    return [row for file in files for row in sorted(rows(file), key=lambda row: row["run"])]


def test_the_file_of_a_worst_case_replays_its_failure(folder, tmp_path, capsys):
    """Every figure but those of wall-clock time is the same, and so is the identity of the run."""
    report = json.loads((folder / "falsification.json").read_text())
    assert report["failure"]
    assert report["runs"] == len(results(folder)) == 10
    command = ["run", str(folder / "worst.toml"), "--seed", str(report["seed"]), "--json"]
    assert main([*command, "--out", str(tmp_path / "run")]) == 3
    summary = json.loads(capsys.readouterr().out)
    assert f"{summary['status']}: {summary['failure']}" == report["failure"]
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
        (["worst", "grass", "gusts"], "did you mean gust?"),
        (["limit", "grass", "gust"], "KEY=LOW:HIGH"),
    ):
        assert main(["search", *words, "--workers", "0"]) == 2
        assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
