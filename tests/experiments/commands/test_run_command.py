"""Several seeds, and how much is printed."""

import json
import re

import pytest
from proving_ground.experiments.commands.cli import main

SHORT = ("run", "grass", "--set", "path={kind='straight', length_m=12}")


@pytest.fixture(scope="module")
def seeds(tmp_path_factory):
    folder = tmp_path_factory.mktemp("seeds") / "out"
    assert main([*SHORT, "--seed", "4", "--seeds", "2", "-o", str(folder), "-q"]) == 0
    return folder


def test_every_seed_has_the_folder_of_a_run_of_its_own(seeds, tmp_path, capsys):
    assert sorted(item.name for item in seeds.iterdir()) == ["seed-4", "seed-5"]
    assert main([*SHORT, "--seed", "5", "-o", str(tmp_path / "alone"), "--json"]) == 0
    alone = json.loads(capsys.readouterr().out)
    one_of_two = json.loads((seeds / "seed-5" / "summary.json").read_text())
    assert (one_of_two["run_id"], one_of_two["tracking"]) == (alone["run_id"], alone["tracking"])


def test_quiet_prints_nothing_and_the_table_has_a_line_for_each_seed(tmp_path, capsys):
    assert main([*SHORT, "--seeds", "2", "-o", str(tmp_path / "a"), "--quiet"]) == 0
    assert capsys.readouterr().out == ""
    assert main([*SHORT, "--seeds", "2", "-o", str(tmp_path / "b"), "-v"]) == 0
    printed = capsys.readouterr().out
    for seed in (1, 2):
        summary = json.loads((tmp_path / "b" / f"seed-{seed}" / "summary.json").read_text())
        (line,) = re.findall(rf"^{seed} +completed(.*)$", printed, re.MULTILINE)
        error = summary["tracking"]["all"]["trailer"]
        shown = [100 * error[key] for key in ("cross_p95_m", "cross_sd_m")]
        assert line.split()[:2] == [f"{value:.1f}" for value in shown]
    assert "Mean of 2 completed runs" in printed


@pytest.mark.parametrize(
    ("more", "words"),
    [(("--seeds", "1"), "from 2 to 1000"), (("-q", "-v"), "not allowed with argument")],
)
def test_bad_input_is_refused(more, words, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*SHORT, *more, "-o", str(tmp_path / "x")])
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "x").exists()


def test_a_live_view_shows_one_run(tmp_path, capsys):
    assert main([*SHORT, "--seeds", "2", "--live", "-o", str(tmp_path / "x")]) == 2
    assert "--live: shows one run" in capsys.readouterr().err
    assert not (tmp_path / "x").exists()
