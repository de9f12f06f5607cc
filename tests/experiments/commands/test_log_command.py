"""`ttempc log` and `ttempc run --live`: output, exit codes, refusals."""

import json
import socket
from dataclasses import replace

import numpy as np
import pytest
from mcap.reader import make_reader
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.logs.check import check_log, recover
from proving_ground.experiments.results.tracking_errors import BODIES, tracking_errors
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.log.reader import read_content, read_log
from proving_ground.testbed.log.writer import LogWriter
from proving_ground.testbed.recording.channels import CHANNELS, ERROR, STATE

SHORT = ("--set", "path={kind='straight', length_m=15}")


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """The log of a short run, recorded at 50 Hz, with a live view without clients."""
    folder = tmp_path_factory.mktemp("run") / "short"
    options = ("--record-rate", "50", "--live", "--speed", "40", "--port", "0")
    assert main(["run", "grass", "--seed", "3", "--out", str(folder), *SHORT, *options]) == 0
    return folder / "log.mcap"


@pytest.fixture(scope="module")
def torn(log, tmp_path_factory):
    """The same log as a kill leaves it."""
    file = tmp_path_factory.mktemp("torn") / "log.mcap.part"
    with log.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    last = max(index.chunk_start_offset for index in summary.chunk_indexes)
    file.write_bytes(log.read_bytes()[: last + 100])
    return file


def test_neither_a_live_view_nor_the_rate_of_the_record_changes_a_bit(log):
    _, scenario = load("grass", [SHORT[1]])
    _, alone = simulate("grass", scenario, seed=3)
    watched = read_log(log)
    assert np.array_equal(watched[STATE].values[::2], alone[STATE].values)
    for channel in CHANNELS[2:6]:  # measurement, estimate, control, tracking
        assert np.array_equal(watched[channel].values, alone[channel].values, equal_nan=True)


def test_the_log_holds_the_true_error_at_every_time_of_the_state(log):
    error, expected = read_log(log, (ERROR,))[ERROR], tracking_errors(read_log(log))
    assert error.time_s.tolist() == expected.time_s.tolist()
    for body in BODIES:
        for part in ("along_m", "cross_m", "euclidean_m"):
            np.testing.assert_array_equal(
                error[f"{body}_{part}"], getattr(expected.by_point[body], part)
            )


def test_info_shows_run_duration_and_topics(log, capsys):
    assert main(["log", "info", str(log)]) == 0
    printed = capsys.readouterr().out
    for word in ("grass", "whole", "/tf", "foxglove.SceneUpdate", "/tyres", "50.0", "15.00 s"):
        assert word in printed
    assert main(["log", "info", str(log), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert (info["state"], info["failures"]) == ("whole", [])
    states = next(topic for topic in info["topics"] if topic["name"] == "/state")
    assert states["messages"] == 751


def test_check_passes_a_whole_log_and_fails_a_torn_one(log, torn, tmp_path, capsys):
    assert main(["log", "check", str(log)]) == 0
    assert "FAIL" not in capsys.readouterr().out
    new = tmp_path / "new.mcap"
    assert main(["log", "check", str(torn), "-o", str(new)]) == 1
    printed = capsys.readouterr().out
    assert "FAIL  whole" in printed
    assert "whole chunks, up to " in printed
    assert main(["log", "check", str(new)]) == 0
    assert main(["log", "export", str(torn), "--out", str(tmp_path / "tables")]) == 0
    assert "torn or damaged" in capsys.readouterr().err
    assert read_content(new).messages == read_content(torn).messages
    assert read_content(new).topics == read_content(torn).topics


def test_check_reports_missing_topics_attachments_and_rows(tmp_path):
    file = tmp_path / "log.mcap"
    with LogWriter(file, metadata={}, attachments={}) as writer:
        for time_s in (0.0, 0.04, 0.02, 0.06, 0.5):
            writer.row(STATE, time_s, [0.0] * len(STATE.fields))
    checks = {each.name: each for each in check_log(read_content(file))}
    assert checks["whole"].passed
    assert "model.xml" in checks["attachments"].detail
    assert "/control" in checks["topics"].detail
    assert "backwards on /state" in checks["time"].detail
    assert "nothing for 440 ms" in checks["truth"].detail
    assert not any(checks[name].passed for name in ("attachments", "topics", "time", "truth"))


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        *(("scenario.toml", b"x = 1"), ("vehicle.toml", b"x = 1"), ("model.xml", b"\xff")),
        *(("ground.npz", b"PK"), ("/tf", b"\xff"), ("/tf", b""), ("/tyres", b"")),
        *(("/control", slice(3)), ("/state", slice(None, None, 2)), ("/tyres", slice(9, None))),
    ],
)
def test_check_finds_wrong_content_behind_right_checksums(log, tmp_path, name, wrong):
    content, file = read_content(log), tmp_path / "log.mcap"
    files, messages = dict(content.attachments), dict(content.messages)
    if name in files:
        files[name] = wrong
    elif isinstance(wrong, bytes):
        messages[name] = [replace(message, data=wrong) for message in messages[name]]
    else:
        messages[name] = messages[name][wrong]
    recover(replace(content, attachments=files, messages=messages), file)
    assert any(not check.passed for check in check_log(read_content(file)))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda content: {"metadata": {}}, "parts"),
        (lambda content: {"metadata": {**content.metadata, "seed": "77"}}, "run"),
        (lambda content: {"metadata": {**content.metadata, "scenario": "other"}}, "lines"),
        (lambda content: {"attachments": {**content.attachments, "x.sh": b"rm"}}, "parts"),
        (lambda content: {"attachments": other_scenario(content)}, "run"),
        (lambda content: {"attachments": other_scenario(content)}, "parts"),
        (lambda content: {"messages": halved(content)}, "lines"),
    ],
)
def test_check_compares_the_parts_of_a_log_with_each_other(log, tmp_path, change, name):
    content, file = read_content(log), tmp_path / "log.mcap"
    recover(replace(content, **change(content)), file)
    checks = {each.name: each for each in check_log(read_content(file))}
    assert not checks[name].passed


def other_scenario(content):
    """Return attachments with the scenario of another run."""
    text = content.attachments["scenario.toml"].replace(
        b"cone_index_kpa = 600.0", b"cone_index_kpa = 500.0"
    )
    assert text != content.attachments["scenario.toml"]
    return {**content.attachments, "scenario.toml": text}


def halved(content):
    """Return messages whose second half is gone on every topic."""
    last = max(group[-1].log_time for group in content.messages.values() if group)
    return {
        topic: [one for one in group if one.log_time < last // 2]
        for topic, group in content.messages.items()
    }


def test_tables_hold_the_log_to_the_bit(log, tmp_path):
    pandas = pytest.importorskip("pandas")
    record = read_log(log)
    for form, read in (("csv", pandas.read_csv), ("parquet", pandas.read_parquet)):
        folder = tmp_path / form
        assert main(["log", "export", str(log), "--out", str(folder), "--format", form]) == 0
        table = read(folder / f"state.{form}")
        assert np.array_equal(table[list(STATE.fields)].to_numpy(), record[STATE].values)
        names = {file.stem for file in folder.iterdir()}
        assert {"mpc_info", "log", "tf", "tyres"} <= names


def test_bad_input_gets_one_line_and_leaves_nothing(log, torn, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "text.mcap").write_text("precious")
    for given, message in (
        (("info", "nowhere.mcap"), "nowhere.mcap: cannot be read"),
        (("check", "text.mcap"), "is not an MCAP log"),
        (("export", log, "--out", "text.mcap"), "exists already"),
        (("export", log, "--out", "text.mcap/new"), "cannot be written"),
        (("export", log, "--format", "xls"), "--format"),
        (("check", torn, "-o", "no/new.mcap"), "cannot be written"),
    ):
        try:
            code = main(["log", *map(str, given)])
        except SystemExit as stopped:  # argparse's way out
            code = stopped.code
        printed = capsys.readouterr()
        assert code == 2
        assert message in printed.err
        assert len(printed.err.strip().splitlines()) == 1
        assert not printed.out
        assert [file.name for file in tmp_path.iterdir()] == ["text.mcap"]
        assert (tmp_path / "text.mcap").read_text() == "precious"


def test_a_taken_port_stops_the_run_before_it_writes(tmp_path, capsys):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = str(other.getsockname()[1])
        code = main(["run", "--live", "--port", port, "--out", str(tmp_path / "new"), *SHORT])
    assert code == 2
    assert f"port {port} is not free" in capsys.readouterr().err
    assert not any(tmp_path.iterdir())
