"""Registry of faults and its table in the documentation."""

from proving_ground.testbed.faults.registry import KINDS, kinds_table

from tests.testbed.plants import ROOT


def test_the_page_has_the_table_of_the_registry():
    assert kinds_table() in (ROOT / "docs/faults.md").read_text()


def test_every_kind_has_a_row():
    rows = [line.split("|")[1] for line in kinds_table().splitlines()[2:]]
    listed = [kind.strip("` ") for row in rows for kind in row.split(",")]
    assert sorted(listed) == sorted(KINDS)
