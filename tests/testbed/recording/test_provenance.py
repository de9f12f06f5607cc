"""Provenance: equal runs have the same identity, different runs different ones."""

import subprocess

from proving_ground.testbed.recording import provenance


def test_the_identity_of_a_run_is_its_scenario_and_its_code():
    code = {"ttempc": "0.1.0", "mujoco": "4.0.0"}
    same = provenance.run_id("seed = 1\n", dict(reversed(code.items())))
    assert provenance.run_id("seed = 1\n", code) == same
    assert provenance.run_id("seed = 2\n", code) != same
    assert provenance.run_id("seed = 1\n", {**code, "mujoco": "4.0.1"}) != same


def test_a_checkout_is_dirty_by_its_code_and_not_by_its_pages(tmp_path):
    def git(*arguments):
        user = ("-c", "user.name=a", "-c", "user.email=a@b")
        subprocess.run(["git", "-C", str(tmp_path), *user, *arguments], check=True)

    def commit():
        return provenance._commit.__wrapped__(tmp_path)

    page, code = tmp_path / "docs" / "page.md", tmp_path / "code.py"
    page.parent.mkdir()
    for file in (page, code):
        file.write_text("first")
    assert commit() == ""
    git("init", "-q")
    git("add", "-A")
    git("commit", "-qm", "first")
    clean = commit()
    assert len(clean) == 12
    page.write_text("second")
    assert commit() == clean
    code.write_text("second")
    assert commit() == f"{clean}-dirty"
