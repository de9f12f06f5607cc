"""`--json`: stdout is JSON and nothing else, with what the text tells."""

import json

from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.scenario.scenario import shipped

from ttempc.guidance.controllers import CONTROLLERS

SHORT = ["--set", "path={kind='straight',length_m=6}"]


def printed(capsys, *arguments):
    assert main([*arguments, "--json"]) in (0, 1)
    return json.loads(capsys.readouterr().out)


def test_list(capsys):
    groups = printed(capsys, "list")
    assert list(groups["scenarios"]) == shipped()
    assert list(groups["controllers"]) == list(CONTROLLERS)
    assert main(["list"]) == 0
    text = capsys.readouterr().out
    assert all(name in text and about in text for g in groups.values() for name, about in g.items())


def test_run_and_log_info(tmp_path, capsys):
    folder = tmp_path / "run"
    summary = printed(capsys, "run", "pavement", *SHORT, "--out", str(folder))
    assert summary == json.loads((folder / "summary.json").read_text())
    info = printed(capsys, "log", "info", str(folder / "log.mcap"))
    assert info["state"] == "whole"
    assert info["failures"] == []
    states = next(topic for topic in info["topics"] if topic["name"] == "/state")
    assert states["messages"] > 100
    assert info["duration_s"] > 5.0
