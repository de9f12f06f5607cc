"""Templates of `ttempc new`: what they start drives as its last line says."""

import shlex

import pytest
from proving_ground.experiments.commands.cli import main

SHORT = ["--set", "path={kind='straight',length_m=10}"]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))


@pytest.mark.parametrize(
    ("kind", "name", "short"),
    [("controller", "my_own", SHORT), ("scenario", "my-field", SHORT), ("study", "my-study", [])],
)
def test_a_template_drives_with_the_command_that_is_printed(kind, name, short, capsys):
    assert main(["new", kind, name]) == 0
    command = shlex.split(capsys.readouterr().out.splitlines()[1])
    assert command[0] == "ttempc"
    assert main([*command[1:], *short]) == 0


@pytest.mark.parametrize("name", ["a b", "../a", "class", "my-own", ""])
def test_a_name_that_is_no_module_is_refused_in_one_line(name, capsys):
    assert main(["new", "controller", name]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_no_file_is_overwritten(tmp_path, capsys):
    (tmp_path / "mine.toml").write_text("mine")
    assert main(["new", "scenario", "mine"]) == 2
    assert (tmp_path / "mine.toml").read_text() == "mine"
    assert "exists already" in capsys.readouterr().err
