"""Frozen trials, their identifier, seeds, scores, cards, comparisons, refusals of the command."""

import json
import tomllib
from dataclasses import replace

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import BadOptions, InvalidScoreCard
from proving_ground.experiments.papers.runner import Runner
from proving_ground.experiments.papers.studies import leaderboard as board
from proving_ground.experiments.studies.sweep.engine import engine
from proving_ground.experiments.studies.sweep.row import columns
from proving_ground.experiments.studies.trials import bench as module
from proving_ground.experiments.studies.trials import definition
from proving_ground.experiments.studies.trials.definition import oracle_error
from proving_ground.experiments.studies.trials.score_card import (
    LOSS_M,
    MARGIN,
    PUBLIC,
    TrialRun,
    compare_cards,
    format_card,
    format_comparison,
    hidden_draws,
    public_draws,
    read_score_card,
    score,
    seeds_hash,
    verdict,
)

from tests.experiments.score_cards import card_of, scored

SHORT = "even-grass"
OWN_SPEED = "controller.options={corridor_at_rest_m=[0.03, 0.05], corridor_per_speed_s=[0.2, 0.03]}"


@pytest.fixture
def one_short_trial(monkeypatch, tmp_path):
    """A single trial of 12 m, whose probe is the frozen one of this fixture."""
    file = tmp_path / f"{SHORT}.toml"
    file.write_text('[path]\nkind = "straight"\nlength_m = 12.0\n')
    files = {SHORT: file}
    for where in (definition, module):
        monkeypatch.setattr(where, "trial_files", lambda: files)
    monkeypatch.setattr(module, "frozen_checks", lambda: {SHORT: definition.plant_check(SHORT)})
    monkeypatch.setattr(definition, "oracle_errors", lambda: {SHORT: {"1": 0.01, "2": 0.03}})


def test_every_scored_trial_has_an_oracle_error_and_the_others_have_faults():
    """Freeze them by `papers oracle`; other trials, another plant or seeds are another version."""
    assert definition.identifier().startswith("v3-")
    assert len(scored()) == 12
    for name in definition.trial_files():
        assert (oracle_error(name) is not None) == (not definition.trial(name).faults)


@pytest.mark.parametrize("name", ["reverse", "work-tool", "faults"])
def test_the_plant_is_that_of_the_frozen_trials(name):
    """With vehicle, soil, implement, faults and samples of the sensors in it."""
    frozen = {name: definition.frozen_checks()[name]}
    assert not definition.differing({name: definition.plant_check(name)}, frozen)


def test_another_scenario_or_plant_makes_another_identifier(monkeypatch):
    name = "reverse"
    content = tomllib.loads(definition.trial_files()[name].read_text())
    probes = definition.frozen_checks()
    before = definition.identifier_of({name: content}, probes)
    other_words = {**content, "description": "other words"}
    assert definition.identifier_of({name: other_words}, probes) == before
    softer = {**content, "soil": {"cone_index_kpa": 599.0}}
    assert definition.identifier_of({name: softer}, probes) != before
    other_plant = {**probes, name: (*probes[name][:-1], probes[name][-1] + 1e-3)}
    assert definition.identifier_of({name: content}, other_plant) != before
    monkeypatch.setattr(definition, "read_scenario", _loaded(definition.read_scenario))
    changed = {name: definition.plant_check(name)}
    assert definition.differing(changed, {name: probes[name]}) == (name,)
    assert definition.identifier((name,)).startswith(definition.identifier() + "+")


def _loaded(read):
    """Return the reader of scenarios, a load of 5 kg on the trailer."""

    class File:
        def __init__(self, name):
            self.file = read(name)
            self.content = self.file.content

        def scenario(self, changes):
            vehicle = {"vehicle": {"load_kg": 5.0}}
            return self.file.scenario({**changes, "plant": vehicle})

    return File


def test_the_cost_of_a_run_is_the_error_of_the_working_point_and_half_a_metre_where_lost():
    done = TrialRun(status="completed", working_p95_m=0.05)
    assert done.cost_m == 0.05
    assert replace(done, status="stopped").cost_m == LOSS_M == 0.5
    assert replace(done, working_p95_m=7.0).cost_m == LOSS_M
    assert replace(done, working_p95_m=None).cost_m == LOSS_M


def test_the_score_is_a_geometric_mean_over_the_oracle_and_scales_with_the_errors():
    errors = np.array([[0.02, 0.04, 0.03], [0.08, 0.04, 0.06]])
    units = np.array([oracle_error(name) for name in scored()[:2]])
    expected = np.exp(np.log(errors.mean(axis=1) / units).mean())
    assert card_of(errors).score.times_oracle.value == pytest.approx(expected, rel=1e-5)
    twice = card_of(errors * [[2.0], [1.0]]).score.times_oracle.value
    assert twice == pytest.approx(2.0**0.5 * expected, rel=1e-5)
    lost = card_of(np.where(errors == 0.08, np.nan, errors)).score
    assert lost.not_completed == 1
    mean_with_loss = (LOSS_M + 0.04 + 0.06) / 3.0
    ratio = np.sqrt(mean_with_loss / errors[1].mean())
    assert lost.times_oracle.value == pytest.approx(ratio * expected, rel=1e-5)


def test_the_score_depends_neither_on_the_order_of_trials_nor_on_that_of_seeds():
    errors = np.random.default_rng(2).uniform(0.01, 0.1, (12, 6))
    runs = card_of(errors).trials
    turned = {name: runs[name][::-1] for name in reversed(runs)}
    first, other = score(runs).times_oracle, score(turned).times_oracle
    assert other.value == pytest.approx(first.value, abs=2e-6)


def test_the_ratio_of_two_scores_does_not_depend_on_the_oracle(monkeypatch):
    errors = np.random.default_rng(5).uniform(0.01, 0.1, (12, 4))
    cards = card_of(errors), card_of(errors[::-1], "two")
    before = compare_cards(*cards)["ratio"]["value"]
    monkeypatch.setattr(definition, "oracle_errors", lambda: {n: {"1": 0.5} for n in scored()})
    assert compare_cards(*cards)["ratio"]["value"] == pytest.approx(before, rel=1e-5)


def test_faults_count_what_comes_home_and_have_no_part_in_the_score():
    kept, lost = ({"faults": (TrialRun(status=s),)} for s in ("completed", "lost"))
    others = card_of([[0.02], [0.03]]).trials
    one, other = (score({**others, **more}) for more in (kept, lost))
    assert one.times_oracle == other.times_oracle
    assert (one.home, other.home) == (1.0, 0.0)
    assert one.not_completed == other.not_completed == 0
    with pytest.raises(InvalidScoreCard, match="oracle"):
        score(kept)


def test_headlands_are_scored_on_their_passes_and_other_paths_everywhere():
    empty = dict.fromkeys(columns(()))
    figures = {
        "tracking.all.trailer.cross_p95_m": 0.09,
        "tracking.passes.trailer.cross_p95_m": 0.03,
        "tracking.passes.tractor.cross_p95_m": 0.05,
    }
    draws = public_draws(PUBLIC[:1])
    plan = module.Entrant.of("pid", []).plan(draws)
    rows = [
        {**empty, **figures, "scenario": plan[run].setting.name, "seed": plan[run].seed}
        | {"status": "completed", "failure": ""}
        for run in plan.runs()
    ]
    runs = module.runs_of(rows, plan, draws)
    assert runs["rough-grass"][0].cost_m == 0.09
    assert runs["headland"][0].cost_m == 0.03
    assert runs["headland"][0].tractor_p95_m == 0.05


def test_ranks_of_level_entries_are_chance_and_of_others_are_not():
    rng = np.random.default_rng(4)
    errors = 0.03 * (1.0 + 0.1 * rng.normal(size=(3, 4, 20)))
    level = [card_of(own) for own in errors]
    first, *_, last = board.rank_shares([card_of(0.5 * errors[0]), *level])
    assert first == 1.0
    assert last < 0.9


def test_a_verdict_needs_the_whole_interval():
    inside = 0.5 * MARGIN
    assert verdict(1.0 - inside, 1.0 + inside).startswith("level")
    assert verdict(0.9, 1.0 - inside) == "ahead"
    assert verdict(1.0 + inside, 1.2) == "behind"
    assert verdict(0.9, 1.1) == "undecided"


def test_a_card_reads_back_and_cannot_be_touched_up(tmp_path):
    card = card_of([[0.02, np.nan], [0.05, 0.06]])
    file = tmp_path / "score.json"
    file.write_text(card.to_json())
    assert read_score_card(file) == card
    content = json.loads(card.to_json())
    content["trials"][scored()[0]][1]["status"] = "completed"
    file.write_text(json.dumps(content))
    with pytest.raises(InvalidScoreCard, match="does not follow"):
        read_score_card(file)
    content["trials"][scored()[0]].pop()
    file.write_text(json.dumps(content))
    with pytest.raises(InvalidScoreCard, match="has 1 runs, must be 2"):
        read_score_card(file)


def test_a_comparison_is_paired_by_seed():
    """A constant factor between runs that differ widely has an interval of no width."""
    errors = np.random.default_rng(1).uniform(0.01, 0.3, (3, 8))
    found = compare_cards(card_of(errors), card_of(0.5 * errors, "two"))
    assert (found["ratio"]["low"], found["ratio"]["high"]) == pytest.approx((0.5, 0.5), abs=1e-6)
    for k, item in enumerate(found["trials"].values()):
        gap = item["difference_m"]
        assert gap["value"] == pytest.approx(-0.5 * errors[k].mean(), abs=1e-5)
        assert gap["low"] < gap["value"] < gap["high"]
    back = compare_cards(card_of(0.5 * errors), card_of(errors))["ratio"]["value"]
    assert back == pytest.approx(1.0 / found["ratio"]["value"], rel=1e-5)
    assert "0.500" in format_comparison(found)


def test_cards_of_other_trials_or_seeds_are_not_compared():
    errors = [[0.02, 0.03]]
    for changes in ({"identifier": "v0-0"}, {"draws": public_draws(PUBLIC[1:3])}):
        with pytest.raises(InvalidScoreCard, match=r"identifier|seeds"):
            compare_cards(card_of(errors), card_of(errors, **changes))


def test_hidden_seeds_are_checked_by_their_hash(tmp_path, capsys):
    file = tmp_path / "seeds.txt"
    assert main(["bench", "--draw-seeds", "-o", str(file)]) == 0
    printed = capsys.readouterr().out.split()[0]
    draws = hidden_draws(file)
    assert draws.sha256 == printed == seeds_hash(draws.seeds)
    assert draws.count == len(PUBLIC)
    assert main(["bench", "--draw-seeds", "-o", str(file)]) == 2


def test_a_file_of_other_seeds_is_refused(tmp_path):
    file = tmp_path / "seeds.txt"
    for text in ("", "1 1", "-3", "1.5", "4294967296", "7 x", "007"):
        file.write_text(text)
        with pytest.raises(BadOptions, match=r"seeds\.txt"):
            hidden_draws(file)


def test_bad_input_gets_one_line_before_any_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for words, reason in (
        ([], "CONTROLLER"),
        (["pid", "--draw-seeds"], "CONTROLLER"),
        (["no-such"], "no-such"),
        (["pid", "--set", "soil.cone_index_kpa=900"], "frozen"),
        (["pid", "--set", "controller.estimator=truth"], "controller.estimator"),
        (["pid", "--quick", "--seeds-file", "x"], "--quick"),
        (["--compare", "a.json", "b.json"], "a.json"),
        (["ttempc", "--set", OWN_SPEED], "corridor"),
        (["nmpc-path"], "space_based"),
    ):
        assert main(["bench", *words]) == 2
        line = capsys.readouterr().err
        assert line.count("\n") == 1
        assert reason in line
    assert not any(tmp_path.iterdir())


def test_a_refused_trial_counts_as_lost():
    """The shipped tube is one for driving forward."""
    draws = public_draws(PUBLIC[:2])
    plan = module.Entrant.of("ttempc-tube", []).plan(draws)
    empty = dict.fromkeys(columns(()))
    rows = [
        {**empty, "scenario": plan[run].setting.name, "seed": plan[run].seed}
        | {"status": "completed", "failure": "", "tracking.all.trailer.cross_p95_m": 0.05}
        for run in plan.runs()
    ]
    runs = module.runs_of(rows, plan, draws)
    costs = {name: [run.cost_m for run in own] for name, own in runs.items()}
    assert costs["reverse"] == [LOSS_M] * 2
    assert costs["wet-slope"] == [0.05] * 2
    assert {run.failure for run in runs["reverse"]} == {
        "the tube was made for another vehicle: reverse 0 (here 1)"
    }


def test_a_bench_drives_resumes_and_keeps_hidden_seeds_hidden(one_short_trial, tmp_path):
    file = tmp_path / "seeds.txt"
    file.write_text("71\n72\n")
    entrant = module.Entrant.of("pid", [])
    rows = []
    with engine(workers=0) as workers:
        card = module.bench(
            entrant, hidden_draws(file), tmp_path / "out", workers, lambda p: rows.append(p.row)
        )
        again = module.bench(
            entrant, hidden_draws(file), tmp_path / "out", workers, lambda p: rows.append(p.row)
        )
    assert [row["seed"] for row in rows] == [71, 72]
    assert replace(again, machine=card.machine) == card
    assert card.identifier == definition.identifier()
    assert [run.status for run in card.trials[SHORT]] == ["completed"] * 2
    assert '"71"' not in card.to_json()
    assert card.draws.seeds is None
    assert card.identifier in format_card(card)


def test_a_controller_that_raises_loses_its_runs(one_short_trial, tmp_path, monkeypatch):
    (tmp_path / "broken.py").write_text(
        "class Broken:\n"
        "    def __init__(self, vehicle, reference, period_s):\n"
        "        raise ValueError('no licence')\n"
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    with engine(workers=0) as workers:
        card = module.bench(
            module.Entrant.of("broken:Broken", []),
            public_draws(PUBLIC[:1]),
            tmp_path / "o",
            workers,
        )
    (run,) = card.trials[SHORT]
    assert (run.status, run.cost_m) == ("failed", LOSS_M)
    assert "no licence" in run.failure
    assert card.source


def test_the_leaderboard_is_made_of_runs_and_of_cards_of_others(
    one_short_trial, tmp_path, monkeypatch
):
    monkeypatch.setattr(board, "SHIPPED", ("pid", "feedforward"))
    monkeypatch.setattr(board, "OTHERS", ("casadi_mpc:CasadiMpc",))
    monkeypatch.setattr(board, "PUBLIC", PUBLIC[:1])
    folder = tmp_path / "rows" / "cards"
    folder.mkdir(parents=True)
    (folder / "theirs.json").write_text(card_of([[0.05]], "theirs").to_json())
    (folder / "old.json").write_text(card_of([[0.05]], "old", identifier="v0-0").to_json())
    text = board.make(Runner(tmp_path / "rows", workers=0))
    names = {"pid.json", "feedforward.json", "casadi_mpc-CasadiMpc.json"}
    assert {file.name for file in folder.iterdir()} == {*names, "theirs.json", "old.json"}
    assert read_score_card(folder / "pid.json").draws.seeds == PUBLIC[:1]
    for name in ("theirs", "CasadiMpc"):
        assert text.count(f"| `{name}` |") == 3  # score, errors, peaks
    assert "not shown: `old` (v0-0)" in text
