"""The command `ttempc serve`: options, addresses, and a controller in C."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.interfaces.serve.link import Link
from proving_ground.experiments.interfaces.serve.session import RemoteController

ROOT = Path(__file__).parents[4]
LOCAL = ("127.0.0.1", 0)
PATIENCE_S = 30.0  # of tests, so that none hangs


def test_bad_options_are_refused_in_one_line(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for options, text in (
        (["--wait", "-1"], "--wait"),
        (["--wait", "1e300", "--step"], "1e6, got 1e300"),
        (["--step", "--speed", "2"], "--speed"),
        (["--peer", "localhost"], "--peer: got 'localhost'"),
        (["--peer", "127.0.0.1:0"], "from 1 to 65535"),
        (["--host", "no.such.host.invalid"], "--host: got 'no.such.host.invalid'"),
        (["--host", "192.0.2.1"], "192.0.2.1:8890"),
    ):
        try:
            code = main(["serve", *options])
        except SystemExit as stopped:  # argparse's way out
            code = stopped.code
        assert code == 2
        error = capsys.readouterr().err
        assert text in error
        assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_port_that_is_taken_is_refused(capsys):
    with Link(LOCAL) as link:
        assert main(["serve", "--port", str(link.address[1])]) == 2
    assert "cannot be opened: Address already in use" in capsys.readouterr().err


def test_listening_to_the_network_says_who_may_drive(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = ["serve", "pavement", "--host", "0.0.0.0", "--port", "0", "--wait", "0.1"]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert "neither password nor encryption" in error
    assert "within 0.1 s" in error
    assert not list(tmp_path.iterdir())  # nothing was written


def test_a_run_over_udp_is_no_run_without_its_peer(tmp_path, capsys):
    name = f"{RemoteController.__module__}:{RemoteController.__qualname__}"
    out = str(tmp_path / "run")
    assert main(["run", "pavement", "--controller", name, "--out", out]) == 2
    assert "was driven over UDP: use ttempc serve" in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_controller_in_c_follows_the_path(tmp_path):
    program = tmp_path / "udp_controller"
    source = ROOT / "docs" / "examples" / "udp_controller.c"
    subprocess.run(
        ["cc", "-O2", "-Wall", "-Wextra", "-Werror", "-o", program, source, "-lm"], check=True
    )
    with Link(LOCAL) as link:
        port = str(link.address[1])
    controller = subprocess.Popen([program, port], stdout=subprocess.PIPE, text=True)
    try:
        path = "path={kind='headland', passes=2, length_m=8}"
        out = tmp_path / "run"
        words = ["serve", "grass", "--set", path, "--step", "--wait", "30", "--port", port]
        assert main([*words, "--out", str(out)]) == 0
        said, _ = controller.communicate(timeout=PATIENCE_S)
    finally:
        controller.kill()
    assert re.match(r'\d+ commands, "status":"completed"', said)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["tracking"]["all"]["tractor"]["p95_m"] < 0.15
    assert summary["tracking"]["all"]["trailer"]["p95_m"] < 0.25
    assert (out / "report.html").exists()
