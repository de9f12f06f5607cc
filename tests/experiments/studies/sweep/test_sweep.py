"""Interrupted, resumed and failing sweeps have the rows of an uninterrupted one."""

import fcntl
import json
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidStudy, SweepRefused, SweepStopped
from proving_ground.experiments.studies.sweep import folder as folder_module
from proving_ground.experiments.studies.sweep import sweep as sweep_module
from proving_ground.experiments.studies.sweep.engine import engine
from proving_ground.experiments.studies.sweep.folder import lock_folder
from proving_ground.experiments.studies.sweep.merge import WHOLE, Shard, merge
from proving_ground.experiments.studies.sweep.results import rows
from proving_ground.experiments.studies.sweep.row import columns, no_figures
from proving_ground.experiments.studies.sweep.sweep import drive_points, sweep
from proving_ground.experiments.studies.sweep.work import run_job
from proving_ground.testbed.recording.provenance import versions

from tests.experiments.study_files import CONTROLLERS, SHORT, STRENGTHS, plan_of


def synthetic_row(job):
    """Return a row without a run; every fifth run is lost."""
    lost = job.run % 5 == 4
    log = ""
    if job.keep != "none":
        log = f"logs/{job.run_id}.mcap"
        (job.folder / log).touch()
    return job.row("lost" if lost else "completed", "", no_figures(), 0.1, log)


def swept(plan, path, work=synthetic_row, on_row=lambda progress: None, shard=WHOLE):
    with engine(workers=0) as inside, lock_folder(path, plan) as folder:
        sweep(plan, folder, inside, on_row, work, shard)
    return sorted(rows(path / "results.jsonl"), key=lambda row: row["run"])


def timeless(row):
    return {
        key: value
        for key, value in row.items()
        if key not in ("wall_s", "attempts") and not key.startswith("timing.")
    }


def check_same(rows, others):
    """Both are rows of the same runs; all figures but times are equal."""
    differing = {
        (one["run"], key): (value, other[key])
        for one, other in zip(map(timeless, rows), map(timeless, others), strict=True)
        for key, value in one.items()
        if value != other[key]
    }
    assert not differing


@pytest.fixture(scope="module")
def real(tmp_path_factory):
    """A plan of real runs, and its rows by one uninterrupted sweep."""
    folder = tmp_path_factory.mktemp("real")
    plan = plan_of(folder, "seeds = 2", SHORT, CONTROLLERS)
    return plan, swept(plan, folder / "out", run_job), folder / "out"


def test_an_interrupted_sweep_ends_with_the_same_rows(real, tmp_path):
    plan, whole, _ = real

    def stop(progress):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        swept(plan, tmp_path / "out", run_job, stop)
    file = tmp_path / "out" / "results.jsonl"
    file.write_bytes(file.read_bytes() + b'{"run":1,"po')  # and the disk was cut off in a row
    again = swept(plan, tmp_path / "out", run_job)
    check_same(again, whole)


@pytest.mark.parametrize("part", ["seeds = 2", "seeds = [2, 1]"])
def test_a_study_that_grows_keeps_its_rows_and_drives_the_others(part, tmp_path):
    """Seeds, controllers and an axis are added; the rows are those of a new sweep of all."""
    first = plan_of(tmp_path, 'keep = "all"', SHORT, CONTROLLERS)
    swept(first, tmp_path / "out")
    whole = (CONTROLLERS.replace('["paper"', '["pid", "paper"'), STRENGTHS.replace("200", "600"))
    more = plan_of(tmp_path, part, 'keep = "all"', SHORT, *whole)
    driven = []

    def counted(job):
        driven.append(job.run_id)
        return synthetic_row(job)

    grown = swept(more, tmp_path / "out", counted)
    new = swept(more, tmp_path / "new")
    known = {first.identity(first[run], versions()) for run in first.runs()}
    assert len(driven) == more.size - len(known)
    assert not known & {*driven}
    same = ("run_id", "run", "point", "seed", "controller", "soil.cone_index_kpa", "log")
    assert [[row[key] for key in same] for row in grown] == [
        [row[key] for key in same] for row in new
    ]
    assert all(list(row) == [*columns(more.study.names)] for row in grown)
    swept(more, tmp_path / "out", pytest.fail)
    assert len({row["log"] for row in grown}) == more.size


@pytest.mark.parametrize("cut", [1, 2, 3])
def test_growth_that_was_cut_off_is_made_up_for(cut, tmp_path, monkeypatch):
    swept(plan_of(tmp_path, SHORT, CONTROLLERS), tmp_path / "out")
    more = plan_of(tmp_path, "seeds = 3", SHORT, CONTROLLERS)
    write, written = folder_module._write, []

    def dies(file, text):
        written.append(file)
        if len(written) == cut:
            raise SweepStopped("killed")
        write(file, text)

    monkeypatch.setattr(folder_module, "_write", dies)
    with pytest.raises(SweepStopped, match="killed"):
        swept(more, tmp_path / "out")
    monkeypatch.undo()
    assert [(row["run"], row["seed"]) for row in swept(more, tmp_path / "out")] == [
        (run, more[run].seed) for run in range(more.size)
    ]


def test_a_run_that_raises_is_a_row_with_the_same_columns(tmp_path, monkeypatch):
    plan = plan_of(tmp_path, SHORT, CONTROLLERS)

    def simulate(name, scenario, seed, log, parts):
        raise ZeroDivisionError("of the controller\nwith a second line")

    monkeypatch.setattr("proving_ground.experiments.studies.sweep.work.simulate", simulate)
    (row, _) = swept(plan, tmp_path / "out", run_job)
    assert (row["status"], row["failure"]) == ("failed", "ZeroDivisionError: of the controller")
    assert list(row) == [*columns(plan.study.names)]


@pytest.mark.parametrize(("keep", "kept"), [("none", []), ("all", [0, 1])])
def test_logs_are_kept_and_named_in_the_rows(keep, kept, tmp_path):
    plan = plan_of(tmp_path, f'keep = "{keep}"', SHORT, CONTROLLERS)
    results = swept(plan, tmp_path / "out", run_job)
    names = sorted(file.name for file in (tmp_path / "out" / "logs").iterdir())
    logs = [f"{results[run]['run_id']}.mcap" for run in kept]
    assert names == sorted(logs)
    assert [row["log"] for row in results if row["log"]] == [f"logs/{log}" for log in logs]


def test_a_folder_in_which_a_sweep_is_at_work_is_refused(tmp_path):
    plan = plan_of(tmp_path, SHORT)
    swept(plan, tmp_path / "out")
    with open(tmp_path / "out" / ".lock", "a") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(SweepRefused, match="another sweep is at work in it"):
            swept(plan, tmp_path / "out")
    swept(plan, tmp_path / "out")


def test_another_study_other_versions_and_foreign_folders_are_refused(tmp_path):
    plan = plan_of(tmp_path, SHORT)
    swept(plan, tmp_path / "out")
    before = {file: file.read_bytes() for file in (tmp_path / "out").glob("[!.]*.*")}
    with pytest.raises(SweepRefused, match=r"holds 1 rows of runs that are not in study tiny"):
        swept(plan_of(tmp_path, SHORT, STRENGTHS), tmp_path / "out")
    assert {file: file.read_bytes() for file in before} == before

    file = tmp_path / "out" / "versions.json"
    content = json.loads(file.read_text())
    content["versions"]["numpy"] = "1.0"
    file.write_text(json.dumps(content))
    with pytest.raises(SweepRefused, match=r"begun with another numpy \(1.0, now"):
        swept(plan, tmp_path / "out")

    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.tex").touch()
    with pytest.raises(SweepRefused, match="holds something else"):
        swept(plan, tmp_path / "mine")
    assert [item.name for item in (tmp_path / "mine").iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize("name", [".lock", "results.jsonl", "versions.json.part", "logs"])
def test_links_in_a_folder_are_refused_and_what_they_name_is_unchanged(name, tmp_path):
    """The folder of a stranger may lead to any file of the user's."""
    plan = plan_of(tmp_path, SHORT)
    swept(plan, tmp_path / "out")
    victim = tmp_path / "victim.txt"
    victim.write_text("mine")
    link = tmp_path / "out" / name
    if link.is_dir():
        link.rmdir()
    link.unlink(missing_ok=True)
    link.symlink_to(victim)
    with pytest.raises(SweepRefused, match=f"{name} is a link"):
        swept(plan, tmp_path / "out")
    assert victim.read_text() == "mine"


@pytest.mark.parametrize("content", ["[]", "null", "[1", '{"a": 1}', "[" * 10**5, '{"runs": -1}'])
def test_malformed_versions_are_refused_in_one_line(content, tmp_path):
    plan = plan_of(tmp_path, SHORT)
    swept(plan, tmp_path / "out")
    (tmp_path / "out" / "versions.json").write_text(content)
    with pytest.raises(SweepRefused, match=r"versions\.json: is not what") as refusal:
        swept(plan, tmp_path / "out")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("run", ["-1", "true", "1", "0.0", '"0"', "1e999"])
def test_a_row_of_no_run_of_the_plan_is_refused(run, tmp_path):
    """The plan has one run, number 0."""
    plan = plan_of(tmp_path, SHORT)
    swept(plan, tmp_path / "out")
    (tmp_path / "out" / "results.jsonl").write_text(f'{{"run": {run}}}\n')
    with pytest.raises(SweepRefused, match="line 1 is no row of this study"):
        swept(plan, tmp_path / "out")


def test_a_worker_with_other_code_ends_the_sweep(tmp_path):
    plan = plan_of(tmp_path, SHORT)
    with pytest.raises(SweepStopped, match="a worker has other code than the driver"):
        swept(plan, tmp_path / "out", lambda job: run_job(replace(job, code="other")))


def test_a_killed_driver_loses_only_the_run_under_way(real, tmp_path):
    plan, whole, _ = real
    (tmp_path / "tiny.toml").write_text(plan.study.dump())
    command = f"{sys.executable} -m proving_ground.experiments.commands.cli sweep tiny.toml"
    file = tmp_path / "runs" / "sweep-tiny" / "results.jsonl"
    driver = subprocess.Popen(
        [*command.split(), "--workers", "0"], cwd=tmp_path, stderr=subprocess.PIPE
    )
    while driver.poll() is None and not (file.exists() and file.read_bytes().count(b"\n")):
        time.sleep(0.02)
    driver.send_signal(signal.SIGKILL)
    driver.communicate()
    assert 0 < len(list(rows(file))) <= 4
    again = swept(plan, file.parent, run_job)
    check_same(again, whole)


def test_a_dry_run_prints_the_size_and_writes_nothing(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    plan_of(tmp_path, "seeds = 3", SHORT, CONTROLLERS)
    assert main(["sweep", "tiny.toml", "--dry-run"]) == 0
    printed = capsys.readouterr().out
    assert "runs      6: 1 points, 3 seeds, 2 controllers" in printed
    assert [item.name for item in tmp_path.iterdir()] == ["tiny.toml"]


SETTINGS = {"path": {"kind": "straight", "length_m": 2.0}, "controller": {"name": "pid"}}
KPA = "soil.cone_index_kpa"


def drive(points, **options):
    with engine(workers=0) as here:
        return drive_points("grass", points, here, settings=SETTINGS, **options)


def test_rows_of_points_come_in_the_order_of_points_and_seeds(monkeypatch):
    def rows_of(engine, jobs, work=None):
        """Return the rows in reverse order."""
        for job in reversed([*jobs]):
            assert job.scenario.controller.name == "pid"
            yield synthetic_row(job)

    monkeypatch.setattr(sweep_module, "imap_rows", rows_of)
    driven = drive([{KPA: 900.0}, {KPA: 300.0}, {KPA: 600.0}], seeds=(7, 5))
    assert [[row[KPA] for row in one] for one in driven] == [[900.0] * 2, [300.0] * 2, [600.0] * 2]
    assert [[row["seed"] for row in one] for one in driven] == [[7, 5]] * 3
    assert [len(one) for one in drive([{KPA: 300.0}, {KPA: -1.0}])] == [1, 0]
    for points in ([{KPA: -1.0}], [], [{}], [{KPA: 300.0}, {"terrain.slope_rad": 0.1}]):
        with pytest.raises(InvalidStudy):
            drive(points)


def test_kept_points_are_not_driven_again(tmp_path):
    points = [{KPA: 300.0}, {KPA: 900.0}]
    driven = drive(points, folder=tmp_path / "kept")
    assert drive(points, folder=tmp_path / "kept") == driven  # wall-clock times among them
    with pytest.raises(SweepRefused):
        drive(points[:1], folder=tmp_path / "kept")


def merged(plan, path, *sources):
    with lock_folder(path, plan) as folder:
        return merge(plan, folder, sources)


def test_shares_are_disjoint_and_together_the_rows_and_logs_of_the_whole(tmp_path):
    plan = plan_of(tmp_path, 'seeds = 5\nkeep = "all"', SHORT, CONTROLLERS)
    whole = swept(plan, tmp_path / "whole")
    shares = [
        swept(plan, tmp_path / name, shard=Shard(number, 2))
        for number, name in enumerate(("one", "two"), 1)
    ]
    assert len(shares[0]) + len(shares[1]) == plan.size
    seeds = [{row["seed"] for row in share} for share in shares]
    assert not seeds[0] & seeds[1]  # the controllers of a seed are in one share
    assert merged(plan, tmp_path / "all", tmp_path / "one") == len(shares[1])
    assert merged(plan, tmp_path / "all", tmp_path / "two", tmp_path / "one") == 0
    rows_of_all = swept(plan, tmp_path / "all", pytest.fail)
    assert rows_of_all == whole
    assert all((tmp_path / "all" / str(row["log"])).is_file() for row in whole)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"run": 10_000}, "10000"),
        ({"run": "0"}, "'0'"),
        ({"log": "../../.bashrc"}, ".bashrc"),
        ({"log": "logs/none.mcap"}, "none.mcap"),
    ],
)
def test_rows_of_a_stranger_are_not_believed(change, named, tmp_path):
    plan = plan_of(tmp_path, SHORT, CONTROLLERS)
    row = swept(plan, tmp_path / "one")[0]
    (tmp_path / "one" / "results.jsonl").write_text(json.dumps(row | change) + "\n")
    with pytest.raises(SweepRefused, match=named):
        merged(plan, tmp_path / "all", tmp_path / "one")


def test_the_folder_of_another_study_is_not_merged(tmp_path):
    swept(plan_of(tmp_path, SHORT, STRENGTHS), tmp_path / "one")
    plan = plan_of(tmp_path, SHORT, CONTROLLERS)
    with pytest.raises(SweepRefused, match="another study"):
        merged(plan, tmp_path / "all", tmp_path / "one")
    assert not (tmp_path / "all" / "results.jsonl").exists()
