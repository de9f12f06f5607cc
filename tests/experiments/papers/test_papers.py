"""Studies against pages, seeds and ledger; regression checks, kept rows, written tables."""

import json
from dataclasses import replace
from functools import partial

import pytest
from proving_ground.experiments.errors import InvalidPage
from proving_ground.experiments.papers import __main__ as command
from proving_ground.experiments.papers import checks
from proving_ground.experiments.papers import runner as module
from proving_ground.experiments.papers import table as table_module
from proving_ground.experiments.papers.checks import (
    Check,
    Fingerprint,
    fingerprint,
    read_ledger,
    scenario_check,
    write_ledger,
)
from proving_ground.experiments.papers.pages import ROOT, blocks, pages_of_tables
from proving_ground.experiments.papers.runner import Runner, check, write_tables
from proving_ground.experiments.papers.table import (
    Block,
    Table,
    all_tables,
    listed,
    study,
    variants,
)
from proving_ground.experiments.seeds import FITTING, TUNING
from proving_ground.experiments.studies.sweep.study import load_study, shipped_studies
from proving_ground.experiments.studies.sweep.work import run_job

from tests.experiments.study_files import CONTROLLERS, SHORT

STRAIGHT = "path={kind='straight',length_m=4}"


@pytest.fixture
def short(monkeypatch):
    """Shorten checks to a second."""
    monkeypatch.setattr(checks, "CHECK_S", 1.0)


def made_up(**changes) -> Table:
    table = Table(
        name="made-up",
        make=lambda runner: Block("| 1 |", {"made-up.png": b"picture"}),
        seeds=(201, 202),
        checks=(("split", "pid"),),
    )
    return replace(table, **changes)


OUTDATED: set[str] = set()
"""Tables of an earlier declaration, as their footer says: `papers NAME` makes them anew."""


@pytest.fixture
def out(tmp_path, monkeypatch):
    """A checkout whose only page has the table."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("no table")
    text = "before\n\n<!-- table: made-up -->\n\nold\n\n<!-- end -->\n\nafter\n"
    (tmp_path / "docs" / "made-up.md").write_text(text)
    monkeypatch.setattr(module, "pages_of_tables", lambda: pages_of_tables(tmp_path))
    return tmp_path


def test_every_marker_has_a_table_and_every_table_a_marker():
    assert pages_of_tables().keys() == all_tables().keys()


def test_a_table_that_was_declared_anew_is_listed_until_it_is_made_anew():
    tables = all_tables()
    outdated = {
        name
        for name, making in read_ledger().items()
        if {item.name for item in tables[name].all_checks} != {*making.checks}
    }
    assert outdated == OUTDATED


def test_no_table_reports_on_seeds_of_the_design():
    design = {*TUNING, *FITTING}
    assert not {n for n, table in all_tables().items() if design & {*table.all_seeds}}
    for name in shipped_studies():
        assert not design & {*load_study(name)[1].point_seeds}, name
    for file in (ROOT / "experiments" / "fitted").glob("*.json"):
        tube = json.loads(file.read_text())
        provenance, calibration = tube["provenance"], tube.get("calibration") or {}
        seeds = provenance["fitted_seeds"] + provenance["held_out_seeds"]
        assert not {*seeds} & {*calibration.get("scored_seeds", [])}
        seeds += calibration.get("scored_seeds", []) + calibration.get("scale_seeds", [])
        assert all(seed in FITTING or seed in TUNING for seed in seeds)


def test_a_check_has_the_same_bits_twice_and_finds_a_changed_radius(short, tmp_path):
    item = scenario_check("split", "pid")
    before = fingerprint(item)
    assert before.compare(fingerprint(item)) == "same bits"
    text = (ROOT / "mjcf" / "vehicles" / "kayacan2016.toml").read_text()
    (tmp_path / "v.toml").write_text(text.replace("radius_m = 0.40\n", "radius_m = 0.4001\n"))
    changed = scenario_check("split", "pid", f'plant.vehicle.file="{tmp_path / "v.toml"}"')
    assert before.compare(fingerprint(changed)) == "differs"


def test_another_processor_is_told_from_another_figure():
    here = Fingerprint("a", (1.0, 2.0))
    assert here.compare(Fingerprint("b", (1.0 + 1e-12, 2.0))) == "equal to 1e-9"
    assert here.compare(Fingerprint("b", (1.0 + 1e-8, 2.0))) == "differs"
    assert here.compare(Fingerprint("a", (1.0, 2.1))) == "differs"  # another error of equal states


def test_of_a_table_without_checks_nobody_claims_that_it_has_the_same_bits(out):
    table = made_up(checks=())
    runner = Runner(out / "rows", workers=0)
    list(write_tables([table], runner, out))
    assert check([table], runner, out) == {"made-up": "no check"}


def test_a_table_is_written_into_its_page_and_a_changed_plant_makes_it_stale(out, short):
    table = made_up()
    assert list(write_tables([table], Runner(out / "rows", workers=0), out)) == [table]
    text = (out / "docs" / "made-up.md").read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| 1 |" in text
    assert "papers made-up`; seeds 201, 202; " in text
    assert (out / "docs" / "made-up.png").read_bytes() == b"picture"
    runner = Runner(out / "rows", workers=0)
    assert check([table], runner, out) == {"made-up": "same bits"}
    again = (out / "docs" / "fingerprints.json").read_bytes()
    write_ledger(read_ledger(out), out)
    assert (out / "docs" / "fingerprints.json").read_bytes() == again

    (item,) = table.all_checks
    terrain = replace(item.scenario.terrain, slope_rad=1e-5)
    changed = fingerprint(Check(item.name, replace(item.scenario, terrain=terrain)))
    runner._fingerprints[item.name] = changed
    others = [made_up(name="new"), made_up(checks=(("split", "lqr"),))]
    assert check([table], runner, out)["made-up"].startswith("differs")
    assert check(others[:1], runner, out)["new"] == "not made"
    assert check(others[1:], runner, out)["made-up"].startswith("other checks")


def weigh(job):
    """Return a row without a drive; how often is in the file beside the rows."""
    with (job.folder.parent / "count").open("a") as count:
        count.write(".")
    return {**job.row("completed", None, {}, None), "weight": 2.0 * job.seed}


def test_rows_of_studies_are_kept_in_order_and_made_once(out, short, capsys):
    own = study(
        "split",
        (201, 202),
        (STRAIGHT,),
        listed("scenario", "split", "pavement"),
        variants("driver", {"a": ('controller.name="pid"',), "b": ()}),
    )
    table = made_up(
        make=None,
        name="grid",
        studies={"one": own, "two": study("split", (203,), (STRAIGHT,))},
        work=weigh,
        text=lambda rows: str([*zip(rows["study"], rows["seed"], rows["weight"], strict=True)]),
    )
    seeds = [201, 202] * 4
    expected = [*(("one", seed, 2.0 * seed) for seed in seeds), ("two", 203, 406.0)]
    for _ in range(2):  # the second time, no row is made
        list(write_tables([table], Runner(out / "rows", workers=0), out))
        assert capsys.readouterr().out.strip() == str(expected)  # no page: printed
        assert (out / "rows" / "count").read_text() == 9 * "."
    (file,) = (out / "rows").glob("grid-one-*/results.jsonl")
    file.write_bytes(file.read_bytes()[:-100])  # a torn last row
    frame = Runner(out / "rows", workers=0).frame(table)
    assert (out / "rows" / "count").read_text() == 10 * "."
    assert [*frame["driver"].dropna()] == ["a", "a", "b", "b"] * 2
    assert {*frame["controller"]} == {"pid", "ttempc"}


def test_a_measure_adds_columns_to_the_row_of_a_run(out, short):
    def measure(job, summary, record):
        return {"rows": float(len(record["/state"])), "of": job.name}

    table = made_up(
        make=None,
        studies={"made-up": study("split", (201,), (STRAIGHT, "controller.name=pid"))},
        work=partial(run_job, measure=measure),
    )
    (row,) = Runner(out / "rows", workers=0).frame(table).to_dict("records")
    assert row["status"] == "completed"
    assert row["rows"] > 50.0
    assert row["of"] == "split"


def test_finished_rows_of_a_sweep_are_those_of_one_plant(tmp_path, short, monkeypatch):
    file = tmp_path / "tiny.toml"
    file.write_text(f"""seeds = [201]\n{SHORT}\n{CONTROLLERS}""".replace("feedforward", "ttempc"))
    tiny = load_study(str(file))
    for place in (table_module, checks):
        monkeypatch.setattr(place, "load_study", lambda name: tiny)
    table = made_up(make=None, sweeps=("tiny",), checks=())
    rows = tmp_path / "rows"
    first = Runner(rows, workers=0).frame(table)
    assert len(first) == 2
    assert {*first["study"]} == {"tiny"}
    (content,) = rows.glob("*/results.jsonl")
    stamp = content.stat().st_mtime_ns
    assert Runner(rows, workers=0).frame(table).equals(first)
    assert content.stat().st_mtime_ns == stamp
    found = fingerprint
    monkeypatch.setattr(module, "fingerprint", lambda item: found(item)._replace(sha256="other"))
    Runner(rows, workers=0).frame(table)
    assert len([*rows.glob("*/results.jsonl")]) == 2


@pytest.mark.parametrize(
    "text",
    [
        "<!-- table: a -->\n",
        "<!-- end -->\n",
        "<!-- table: a -->\n<!-- end -->\n<!-- table: a -->\n<!-- end -->\n",
        "<!-- table: a -->\n<!-- table: b -->\n<!-- end -->\n",
    ],
)
def test_invalid_markers_and_ledgers_are_refused(text, out):
    with pytest.raises(InvalidPage):
        blocks(text)
    (out / "docs" / "fingerprints.json").write_text("[]")
    with pytest.raises(InvalidPage, match="fingerprints"):
        read_ledger(out)


def test_the_command_lists_and_refuses(capsys):
    assert command.main([]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in all_tables())
    with pytest.raises(SystemExit) as refusal:
        command.main(["nothing"])
    assert refusal.value.code == 2
    assert "nothing" in capsys.readouterr().err
