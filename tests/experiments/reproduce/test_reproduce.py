"""List of tables against the pages, seeds, probes that find a changed constant, blocks."""

import json
from collections import Counter
from dataclasses import replace

import pytest
from proving_ground.experiments.errors import InvalidPage
from proving_ground.experiments.reproduce import driver as driver_module
from proving_ground.experiments.reproduce import listing, probes
from proving_ground.experiments.reproduce import reproduce as module
from proving_ground.experiments.reproduce.driver import Driver
from proving_ground.experiments.reproduce.entry import Entry, Product
from proving_ground.experiments.reproduce.ledger import read_ledger
from proving_ground.experiments.reproduce.listing import ENTRIES
from proving_ground.experiments.reproduce.pages import ROOT, blocks, with_block
from proving_ground.experiments.reproduce.probes import Fingerprint, Probe, fingerprint, probe
from proving_ground.experiments.scenario.scenario import load, shipped
from proving_ground.experiments.seeds import FITTING, TUNING, design_seeds
from proving_ground.experiments.sweep.study import ListAxis, load_study, shipped_studies

from tests.experiments.study_files import CONTROLLERS, SHORT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SHORT_S = 1.0


@pytest.fixture
def short(monkeypatch):
    """Shorten probes to a second."""
    monkeypatch.setattr(probes, "PROBE_S", SHORT_S)


def made_up(**changes) -> Entry:
    entry = Entry(
        name="made-up",
        page="docs/made-up.md",
        make=lambda driver: Product("| 1 |", {"made-up.png": b"picture"}),
        seeds=(201, 202),
        probes=(("split", "pid"),),
    )
    return replace(entry, **changes)


@pytest.fixture
def out(tmp_path):
    (tmp_path / "docs").mkdir()
    text = "before\n\n<!-- table: made-up -->\n\nold\n\n<!-- end -->\n\nafter\n"
    (tmp_path / "docs" / "made-up.md").write_text(text)
    return tmp_path


def test_every_marker_has_an_entry_and_every_entry_a_marker():
    there = Counter(
        (name, page.relative_to(ROOT).as_posix())
        for page in PAGES
        for name in blocks(page.read_text())
    )
    assert there == Counter((entry.name, entry.page) for entry in ENTRIES)


def test_every_record_is_of_a_listed_table_and_its_probes():
    known = {entry.name: entry for entry in ENTRIES}
    for name, making in read_ledger().entries.items():
        assert {item.name for item in known[name].all_probes()} == set(making.probes)


def test_no_table_reports_on_seeds_of_the_design():
    assert not {entry.name for entry in ENTRIES if design_seeds(entry.all_seeds())}
    for name in shipped_studies():
        assert not design_seeds(load_study(name)[1].point_seeds), name


def test_the_shipped_tubes_were_fitted_with_declared_seeds():
    for file in (ROOT / "experiments" / "fitted").glob("*.json"):
        tube = json.loads(file.read_text())
        provenance, calibration = tube["provenance"], tube.get("calibration") or {}
        seeds = provenance["fitted_seeds"] + provenance["held_out_seeds"]
        assert not {*seeds} & {*calibration.get("scored_seeds", [])}
        seeds += calibration.get("scored_seeds", []) + calibration.get("scale_seeds", [])
        assert all(seed in FITTING or seed in TUNING for seed in seeds)


def test_the_comparison_drives_every_shipped_scenario_at_one_speed():
    """In a corridor each controller has a speed of its own, and errors would not be comparable."""
    axis = load_study("compare")[1].axis[0]
    assert isinstance(axis, ListAxis)
    assert set(axis.values) == {name for name in shipped() if load(name)[1].corridor is None}


def test_all_shipped_studies_are_behind_a_table():
    assert {name for entry in ENTRIES for name in entry.sweeps} == {*shipped_studies()}
    assert set(listing.SWEEP_MINUTES) == {*shipped_studies()}


def test_a_probe_has_the_same_bits_twice_and_finds_a_changed_radius(short, tmp_path):
    item = probe("split", "pid")
    before = fingerprint(item)
    assert before.compare(fingerprint(item)) == "same bits"
    text = (ROOT / "mjcf" / "vehicles" / "kayacan2016.toml").read_text()
    (tmp_path / "v.toml").write_text(text.replace("radius_m = 0.40\n", "radius_m = 0.4001\n"))
    changed = probe("split", "pid", f'plant.vehicle.file="{tmp_path / "v.toml"}"')
    assert before.compare(fingerprint(changed)) == "differs"


def test_another_processor_is_told_from_another_figure():
    here = Fingerprint("a", (1.0, 2.0))
    assert here.compare(Fingerprint("b", (1.0 + 1e-12, 2.0))) == "equal to 1e-9"
    assert here.compare(Fingerprint("b", (1.0 + 1e-8, 2.0))) == "differs"
    assert here.compare(Fingerprint("a", (1.0, 2.1))) == "differs"  # another error of equal states


def test_a_table_is_written_into_its_page_with_its_line_and_record(out, short):
    entry = made_up()
    assert list(module.reproduce([entry], Driver(out / "rows", workers=0), out)) == [entry]
    text = (out / "docs" / "made-up.md").read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert "| 1 |" in text
    assert "`ttempc reproduce made-up`; seeds 201, 202; " in text
    assert (out / "docs" / "made-up.png").read_bytes() == b"picture"
    verdicts = module.check([entry], Driver(out / "rows", workers=0), out)
    assert [item.state for item in verdicts] == ["same bits"]
    again = (out / "docs" / "fingerprints.json").read_bytes()
    read_ledger(out).write(out)
    assert (out / "docs" / "fingerprints.json").read_bytes() == again


def test_a_changed_plant_makes_its_table_stale(out, short):
    entry = made_up()
    list(module.reproduce([entry], Driver(out / "rows", workers=0), out))
    (item,) = entry.all_probes()
    terrain = replace(item.scenario.terrain, slope_rad=1e-5)
    driver = Driver(out / "rows", workers=0)
    driver._fingerprints[item.name] = fingerprint(
        Probe(item.name, replace(item.scenario, terrain=terrain))
    )
    (verdict,) = module.check([entry], driver, out)
    assert (verdict.state, verdict.probe, verdict.holds) == ("differs", item.name, False)
    (other,) = module.check([made_up(probes=(("split", "lqr"),))], driver, out)
    assert (other.state, other.holds) == ("other probes", False)
    (new,) = module.check([made_up(name="new")], driver, out)
    assert (new.state, new.holds) == ("not made", False)


def test_finished_rows_are_taken_again_and_those_of_another_plant_are_not(
    tmp_path, short, monkeypatch
):
    file = tmp_path / "tiny.toml"
    file.write_text(f"""seeds = [201]\n{SHORT}\n{CONTROLLERS}""".replace("feedforward", "ttempc"))
    tiny = load_study(str(file))
    for place in (driver_module, probes):
        monkeypatch.setattr(place, "load_study", lambda name: tiny)
    first = Driver(tmp_path / "rows", workers=0).rows("tiny")
    content = (first / "results.jsonl").read_bytes()
    assert content.count(b"\n") == 2
    assert Driver(tmp_path / "rows", workers=0).rows("tiny") == first
    assert (first / "results.jsonl").read_bytes() == content
    probe_of = probes.fingerprint
    monkeypatch.setattr(
        driver_module, "fingerprint", lambda item: replace(probe_of(item), sha256="another plant")
    )
    assert Driver(tmp_path / "rows", workers=0).rows("tiny") != first
    rehearsal = Driver(tmp_path / "rows", workers=0, seeds=(7, 8)).sweep("tiny")
    assert {row["seed"] for row in rehearsal.rows} == {7, 8}


def test_nothing_is_driven_for_a_page_without_markers(out):
    entry = made_up(name="other")
    driver = Driver(out / "rows", workers=0)
    with pytest.raises(InvalidPage, match=r"docs/made-up\.md: has no marker .*other"):
        list(module.reproduce([entry], driver, out))
    assert not driver._fingerprints


@pytest.mark.parametrize(
    "text",
    [
        "<!-- table: a -->\n",
        "<!-- end -->\n",
        "<!-- table: a -->\n<!-- end -->\n<!-- table: a -->\n<!-- end -->\n",
        "<!-- table: a -->\n<!-- table: b -->\n<!-- end -->\n",
    ],
)
def test_markers_without_a_counterpart_are_refused(text):
    with pytest.raises(InvalidPage):
        with_block(text, "a", "1")


def test_a_record_that_nobody_wrote_is_refused(out):
    (out / "docs" / "fingerprints.json").write_text("[]")
    with pytest.raises(InvalidPage, match="is not what"):
        read_ledger(out)
