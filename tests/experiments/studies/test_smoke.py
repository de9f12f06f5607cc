"""Smoke tests: every study whose figures docs/ quotes runs, and prints a table of its form."""

from functools import partial

import numpy as np
import pytest
from proving_ground.experiments.results.published import COLUMNS
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.scenario.tube_file import read_tube, to_json
from proving_ground.experiments.studies import (
    batch,
    cards,
    containment,
    endurance,
    errata,
    estimators,
    front,
    invariance,
    learning,
    paper_tube,
    ranking,
    roughness,
)
from proving_ground.experiments.studies.ablations import (
    ablation,
    ancillary_gain,
    conditions,
    limits,
    recovery,
)
from proving_ground.experiments.studies.failures import breaking_points, worst_cases
from proving_ground.experiments.studies.faults import calibration, false_alarms, stuck_valves
from proving_ground.experiments.studies.faults import study as faults
from proving_ground.experiments.sweep.engine import engine
from proving_ground.testbed.validation.validate import EXPERIMENTS

from ttempc.guidance.detection import detectors

STRAIGHT = 'path={kind="straight",length_m=10.0}'


@pytest.fixture(autouse=True)
def in_this_process(monkeypatch):
    monkeypatch.setattr(batch, "engine", lambda workers: engine(0))


def first(table, count):
    return dict(list(table.items())[:count])


def rows(capsys):
    """Return the rows of the printed Markdown table, its head first, all of one width."""
    lines = capsys.readouterr().out.splitlines()
    table = [line.strip("|").split("|") for line in lines if line.startswith("|")]
    assert len({len(row) for row in table}) == 1
    head, rule, *body = [[cell.strip() for cell in row] for row in table]
    assert set(rule) == {"---"}
    return head, body


def finite(cells):
    """Return the cells as numbers; those of the curve are NaN on a straight path."""
    numbers = [float(cell) for cell in cells]
    assert all(number == number for number in numbers)
    return numbers


def test_ablation(capsys, monkeypatch):
    monkeypatch.setattr(ablation, "VARIANTS", first(ablation.VARIANTS, 2))
    ablation.main((1,), ("grass",), STRAIGHT)
    head, body = rows(capsys)
    assert head[2:6] == list(COLUMNS)
    assert [row[1] for row in body] == list(ablation.VARIANTS)
    feedforward, mpc = (finite(row[2:4]) for row in body)
    assert feedforward != mpc
    assert [row[-1] for row in body] == ["0/1", "0/1"]


def test_ancillary_gain(capsys, monkeypatch):
    monkeypatch.setattr(ancillary_gain, "TICKS", 60)
    ancillary_gain.main()
    _, body = rows(capsys)
    design, _, default, none = (finite(row[1:4]) for row in body)
    assert default[0] < design[0]
    assert none == [0.0, 0.0, 0.0]


def test_conditions(capsys, monkeypatch):
    changes = {name: conditions.CHANGES[name] for name in ("`grass` as it is", "150 kPa")}
    monkeypatch.setattr(conditions, "CHANGES", changes)
    conditions.main((1,), "pid", STRAIGHT)
    head, body = rows(capsys)
    assert head == ["pid", *COLUMNS, "lost"]
    assert [row[0] for row in body] == [*changes]
    assert finite(body[0][1:3]) != finite(body[1][1:3])


def test_consistency_of_the_estimator(capsys):
    estimators.print_consistency((1,), ("grass",), (STRAIGHT,))
    head, (row,) = rows(capsys)
    assert head[1:8] == ["x", "y", "psi_t", "psi_i", "delta_t", "delta_i", "v"]
    assert row[0] == "`grass`"
    assert finite(row[1:])[head.index("NIS") - 1] == pytest.approx(1.0, abs=0.3)


def test_errata(capsys, monkeypatch):
    monkeypatch.setattr(errata, "READINGS", first(errata.READINGS, 2))
    errata.main((1,), STRAIGHT)
    head, body = rows(capsys)
    assert head == ["reading", *COLUMNS, "lost"]
    assert [row[0] for row in body] == [*errata.READINGS]


def test_front(tmp_path, capsys, monkeypatch):
    """A higher weight moves the hydrostat less."""
    monkeypatch.setattr(front, "SCENARIOS", ("grass",))
    monkeypatch.setattr(front, "_WEIGHTS", {"ttempc": (0.01, 10.0), "pid": (None,)})
    front.main((1,), tmp_path, 'path={kind="straight",length_m=15.0}')
    head, body = rows(capsys)
    travel = [float(row[head.index("hydrostat [%/m]")]) for row in body]
    assert travel[0] > 2.0 * travel[1]
    assert [row[2] for row in body] == ["0.01", "10", "–"]
    assert (tmp_path / front.FILE).stat().st_size > 1000


def test_estimators(capsys):
    estimators.main(("grass",), (1,), STRAIGHT)
    head, body = rows(capsys)
    assert [row[1] for row in body] == ["`ekf`", "`nmhe`"]
    cost = head.index("ms")
    assert float(body[0][cost]) < float(body[1][cost])


def test_breaking_points(capsys, monkeypatch):
    monkeypatch.setattr(breaking_points, "TOLERANCES", {"slope": 0.4})
    monkeypatch.setattr(breaking_points, "CONTROLLERS", ("pid",))
    breaking_points.main((1,), STRAIGHT)
    head, ((quantity, values),) = rows(capsys)
    assert head == ["quantity", "`pid`"]
    assert quantity == "slope [rad]"
    assert values.startswith("holds") or float(values.split(",")[0]) < float(values.split(",")[1])


def test_worst_cases(capsys, monkeypatch):
    monkeypatch.setattr(worst_cases, "PATH", 'path={kind="straight",length_m=3.0}')
    monkeypatch.setattr(worst_cases, "RARE", ())  # tests/experiments/search has the probability
    worst_cases.main(3, (1,), ("pid",))
    gust, patch = (part.splitlines() for part in capsys.readouterr().out.split("**: ")[1:3])
    for title, head, _, row in (gust[:1] + gust[2:5], patch[:1] + patch[2:5]):
        assert title.startswith(("`gust`", "`soil-patch slope"))
        assert head.count("|") == row.count("|")
        assert row.split("|")[2].endswith("of 3 ")


def test_learning(capsys, monkeypatch):
    monkeypatch.setattr(learning, "FACTORS", ((1.2, 1.0, 1.0, 1.0),))
    monkeypatch.setattr(learning, "PATH", STRAIGHT)
    learning.main("pid", (1,))
    head, (without, learnt) = rows(capsys)
    assert head[-1] == "second lap"
    assert [without[1], learnt[1]] == ["no", "yes"]
    assert without[2] == learnt[2]  # too short to learn anything


def test_limits(capsys):
    limits.main((1,), ("grass",), (STRAIGHT,))
    out = capsys.readouterr().out
    errors, shares = (
        [line.split("|") for line in part.splitlines()] for part in out.split("\n\n")[:2]
    )
    assert errors[0][2:-2] == [f" {name} " for name in limits.VARIANTS]
    as_it_is, clean, truth, level, _ = (float(cell.split("/")[0]) for cell in errors[2][2:-1])
    assert as_it_is > clean >= truth >= level
    parts = [int(cell.split("/")[0]) for cell in shares[2][2 : 2 + len(limits.PARTS)]]
    assert sum(parts) == pytest.approx(100, abs=2)  # rounded


def test_recovery(capsys, monkeypatch):
    monkeypatch.setattr(recovery, "OFFSETS", ((0.3, 5.0),))
    monkeypatch.setattr(recovery, "SCENARIOS", ("grass",))
    monkeypatch.setattr(recovery, "recover", partial(recovery.recover, ticks=50))
    recovery.main("pid", (1,))
    _, (row,) = rows(capsys)
    assert row[0] == "`grass`"
    assert row[-1] == "kept"


def test_containment(tmp_path, capsys, monkeypatch):
    own = containment.Case("grass", path=STRAIGHT)
    borrowed = containment.Case("grass", tube_of="own", path=STRAIGHT)
    monkeypatch.setattr(containment, "CASES", {"own": own, "borrowed": borrowed})
    (tmp_path / "own.json").write_text(to_json(read_tube("grass")))
    arguments = [str(tmp_path), "--laps", "1", "--calibration-laps", "0"]
    for _ in range(2):  # the second time every lap is there
        containment.main(arguments)
        lines = capsys.readouterr().out.splitlines()
        assert [line.split("|")[1].strip() for line in lines[2:4]] == ["`own`", "`borrowed`"]
    assert len(containment.read_laps(tmp_path)) == 2


def test_containment_reports_a_tube_that_cannot_be_fitted(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(containment, "CASES", {"own": containment.Case("grass", path=STRAIGHT)})
    containment.main([str(tmp_path), "--laps", "1", "--fit-laps", "3"])
    assert "`own`: " in capsys.readouterr().out


def test_endurance(capsys):
    endurance.main("0.001")
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == [f"class {name}" for name in "ABCDEF"]
    assert all(line.endswith("invalid 0 times") for line in lines)


def test_invariance(capsys, monkeypatch):
    for name, count in (("RANDOM", 30), ("BATCH", 10), ("WORST", 20), ("STRIDE", 300)):
        monkeypatch.setattr(invariance, name, count)
    invariance.main("grass")
    lines = capsys.readouterr().out.splitlines()
    condition, *shares = (float(line.split()[-1]) for line in lines[1:])
    assert condition <= 1.0 + 1e-6
    assert len(shares) == 4
    assert all(share <= 1.0 + 1e-6 for share in shares)


def test_paper_tube(capsys, monkeypatch):
    monkeypatch.setattr(paper_tube, "DRAWS", 20)
    paper_tube.main()
    printed = capsys.readouterr().out
    assert printed.count("largest moduli") == 4
    assert printed.count("without x_i") == 4


def test_cards(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(cards, "shipped", lambda: [])
    for name in set(EXPERIMENTS) - {"static loads", "free fall"}:
        monkeypatch.setitem(EXPERIMENTS, name, lambda bench: [])
    cards.main(tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        "grass-contact.html",
        "grass-contact.json",
    }
    _, (row,) = rows(capsys)
    assert row[0] == "[grass-contact](grass-contact.html)"


def test_ranking(capsys, monkeypatch):
    monkeypatch.setattr(ranking, "CONTROLLERS", ("ttempc", "pid"))
    for line in ranking.table(2, ("grass",), STRAIGHT):
        print(line)
    _, body = rows(capsys)
    (field, rival, _, ahead, _, _) = body[0]
    assert (field, rival) == ("`grass`", "`pid`")
    assert "/2 " in ahead


def test_a_draw_of_the_ranking_stays_within_half_of_the_values_that_ship():
    count = len(ranking.VEHICLE) + len(ranking.LAW) + 1
    shipped = load("grass")[1]
    for corner, factor in ((0.0, 0.5), (0.5, 1.0), (1.0, 1.5)):
        scenario = load("grass", ranking.changes(np.full(count, corner)))[1]
        law, vehicle = scenario.plant.wheel_law, scenario.vehicles()
        assert law.relaxation_lat_m == factor * shipped.plant.wheel_law.relaxation_lat_m
        assert vehicle.plant.tractor.mass_kg == factor * shipped.vehicles().plant.tractor.mass_kg
        assert vehicle.mismatch == ()


def test_roughness(capsys, monkeypatch):
    fields = dict(list(roughness.FIELDS.items())[:3])
    monkeypatch.setattr(roughness, "FIELDS", fields)
    monkeypatch.setattr(roughness, "PATH", STRAIGHT)
    roughness.main(1)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split("|")[1].strip() for line in lines[2:5]] == [*fields]
    assert lines[-1].startswith("Exponent of the ground factor: tractor ")


def test_a_law_with_the_right_form_predicts_a_field_that_it_has_not_seen():
    ground = np.array([0.03, 0.2, 1.0, 5.0, 40.0])
    width = np.sqrt(0.02**2 + 0.05**2 * np.sqrt(ground))
    np.testing.assert_allclose(roughness.left_out(ground, width), 1.0)
    assert np.ptp(roughness.left_out(ground, 0.05 * np.sqrt(ground))) > 0.5


def test_faults(capsys, monkeypatch):
    monkeypatch.setattr(faults, "_AFTER_S", 7.0)
    faults.main((1,), ("pid",), ("stone, 150 Ns", "front steering stuck"))
    head, body = rows(capsys)
    assert head[1:5] == ["carried on", "degraded", "stopped", "lost"]
    assert body[0][1] == "1 (3..100 %)"
    assert body[1][3] == "1 (3..100 %)"
    noticed, stop = (float(body[1][column].split(",")[0]) for column in (5, 7))
    assert 0.0 < noticed < 2.0
    assert 0.5 < stop < 5.0


def test_stuck_valves(capsys, monkeypatch):
    monkeypatch.setattr(stuck_valves, "_SECONDS", 5.0)
    stuck_valves.main((1,))
    _, body = rows(capsys)
    for row in body:
        shown, noticed, after = (float(cell.split(",")[0]) for cell in row[1:4])
        assert 0.0 < shown <= noticed
        assert after == pytest.approx(noticed - shown, abs=0.11)


def test_a_stuck_hitch_sensor_is_left_out_and_the_vehicle_drives_on(monkeypatch):
    monkeypatch.setattr(faults, "_AFTER_S", 15.0)
    result = faults.drive_case(faults.Case("hitch angle stuck", "ttempc", 1))
    assert result.result == "degraded"
    assert result.noticed_s <= 1.0
    assert result.worst_m < 0.2


def test_false_alarms(capsys, monkeypatch):
    monkeypatch.setattr(false_alarms, "fields", lambda: ("split", "trial patches"))
    false_alarms.main((201, 202))
    out = capsys.readouterr().out
    quiet, slips = (line.split(" | ") for line in out.splitlines()[2:4])
    assert quiet[1:] == ["0.01", "-", "-", "- |"]
    assert slips[2:4] == ["-", "-"]
    assert "wheels: 1" in slips[4]  # the wheels spin on soft patches
    assert "False alarms of both kinds: 0 in" in out


def test_limits_of_detectors():
    values = calibration.residuals(calibration.Drive("pavement", 1, 4.0))
    assert values.shape == (20, len(detectors()))


def test_the_limit_of_a_sum_is_that_of_white_noise():
    """For a Gaussian mean of 5 ticks: theta = 2 k / sigma^2, as of a Brownian motion with drift."""
    rng = np.random.default_rng(1)
    values = rng.choice([-1.0, 1.0], 500_000) * (5.0 + rng.normal(0.0, 1.0, 500_000))
    limit = calibration.sum_limit(values, 5.5, per_s=5)
    level = np.log(calibration.FALSE_ALARM_S * len(detectors()))
    assert limit == pytest.approx(level / (2.0 * 0.5), rel=0.05)


def test_the_limit_of_maxima_is_that_of_a_gumbel_distribution():
    rng = np.random.default_rng(2)
    squares = rng.gumbel(10.0, 2.0, 20_000)
    values = np.sqrt(np.repeat(np.maximum(squares, 0.0), 50))
    count = calibration.FALSE_ALARM_S / 10.0 * len(detectors())
    limit = calibration.maximum_limit(values, per_s=5)
    assert limit == pytest.approx(np.sqrt(10.0 + 2.0 * np.log(count)), rel=0.02)
