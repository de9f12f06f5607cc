"""Controllers and estimators of a user's own package: by name, refused with a reason, guarded."""

import os
import sys
import threading

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidController
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.run.user_code import exits_raise
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.studies.sweep.engine import engine
from proving_ground.testbed.log.reader import read_log
from proving_ground.testbed.recording.channels import CONTROL, STATE
from proving_ground.testbed.simulation.loop import with_stages

from ttempc.guidance.controllers import make_controller
from ttempc.types import Command, ControlStep, Input
from ttempc.vehicle import Vehicle

SHORT = ("path={kind='straight', length_m=4.0}", "terrain.iso_class='flat'")

MODULE = """
from ttempc.guidance.controllers import make_controller

value = 3

def paper(vehicle, reference, period_s):
    return make_controller("feedforward", vehicle, reference, period_s)

def nothing(vehicle, reference, period_s):
    return None

def broken(vehicle, reference, period_s):
    raise ValueError("two\\nlines")

"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A package `lawn` in the working directory."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    (tmp_path / "lawn").mkdir()
    (tmp_path / "lawn" / "drivers.py").write_text(MODULE)
    (tmp_path / "lawn" / "ill.py").write_text("1 / 0")
    yield tmp_path
    for name in [name for name in sys.modules if name.split(".")[0] == "lawn"]:
        del sys.modules[name]


def test_what_cannot_drive_is_refused_in_one_line_and_nothing_is_written(package, capsys):
    def files():
        return {file for file in package.rglob("*") if "__pycache__" not in file.parts}

    before = files()
    for name, said in (
        ("lawn.drivers:none", "lawn.drivers has no none; it defines "),
        ("lawn.drivers:nothin", "(did you mean nothing?)"),
        ("lawn.drivers:value", "value is int"),
        ("lawn.drivers:nothing", "NoneType, which has no method step"),
        ("lawn.drivers:broken", "raised ValueError: two lines"),
        ("lawn.ill:make", "importing lawn.ill raised ZeroDivisionError"),
        ("lawn.meadow:make", "no module 'lawn.meadow'"),
        ("nowhere:make", "no module 'nowhere'"),
        ("lawn.drivers:", "package.module:factory"),
        ("lawn drivers:make", "package.module:factory"),
    ):
        assert main(["run", "--controller", name, "--out", "new", "--set", SHORT[0]]) == 2
        printed = capsys.readouterr().err
        assert said in printed
        assert len(printed.strip().splitlines()) == 1
        assert files() == before


def test_a_name_means_the_same_as_the_factory_itself_also_in_other_processes(package):
    overrides = (*SHORT, 'controller.name="lawn.drivers:paper"')
    mine = simulate(*load("grass", overrides), seed=3)[0]
    shipped = simulate(*load("grass", (*SHORT, 'controller.name="feedforward"')), seed=3)[0]
    assert mine.tracking == shipped.tracking
    with engine(1) as workers:
        afar, _ = workers.executor.submit(simulate, *load("grass", overrides), 3).result()
    assert afar.tracking == mine.tracking


ENDS = """
import os

from ttempc.types import Command, ControlStep

class Base:
    def __init__(self, vehicle, reference, period_s):
        pass
    def step(self, estimate, k):
        return Command(0.0, 0.0, 0.5)

class Exits(Base):
    def step(self, estimate, k):
        raise SystemExit(0)

class Unprepared(Base):
    def prepare(self, k):
        raise SystemExit(0)

class Cold(Base):
    def warm_up(self):
        raise RuntimeError("too cold")
"""


def test_no_method_of_a_controller_ends_the_program(package, capsys):
    (package / "lawn" / "ends.py").write_text(ENDS)
    for name, reason in (
        ("Exits", "SystemExit"),
        ("Unprepared", "SystemExit"),
        ("Cold", "too cold"),
    ):
        command = ["run", "--controller", f"lawn.ends:{name}", "--out", name, "--set", SHORT[0]]
        assert main([*command, "--set", SHORT[1]]) == 3
        assert reason in capsys.readouterr().err  # the traceback
        assert reason in (package / name / "summary.json").read_text()
        events = [event.text for event in read_log(package / name / "log.mcap").events]
        assert any("Traceback" in text and "lawn/ends.py" in text for text in events)
        assert not (package / name / "log.mcap.part").exists()


def test_options_of_a_scenario_reach_a_users_controller(package):
    (package / "lawn" / "tuned.py").write_text(
        "from ttempc.types import Command\n"
        "class Tuned:\n"
        "    def __init__(self, vehicle, reference, period_s, hp=0.0):\n"
        "        self.hp = hp\n"
        "    def step(self, estimate, k):\n"
        "        return Command(0.0, 0.0, self.hp)\n"
    )
    named = (*SHORT, 'controller.name="lawn.tuned:Tuned"')
    _, record = simulate(*load("grass", (*named, "controller.options.hp=0.6")), seed=1)
    assert record[CONTROL]["hp_command"][-1] == 0.6
    with pytest.raises(InvalidController, match="speed"):
        simulate(*load("grass", (*named, "controller.options.speed=0.6")), seed=1)


def test_options_from_python_are_values_of_a_scenario():
    taken = []

    def factory(vehicle, reference, period_s, **options):
        taken.append(options)
        return make_controller("pid", vehicle, reference, period_s)

    name, scenario = load("grass", SHORT)
    simulate(name, scenario, seed=1, factory=factory, options={"a": (1.0, 2.0), "b": np.ones(2)})
    assert taken == [{"a": [1.0, 2.0], "b": [1.0, 1.0]}]
    for value in ({"c": 1}, [[1.0]], object()):
        with pytest.raises(InvalidController, match=r"options\.q"):
            simulate(name, scenario, seed=1, factory=factory, options={"q": value})


def test_an_estimator_of_a_users_own_drives_by_name(package):
    (package / "lawn" / "watch.py").write_text(
        "from ttempc.estimation.ekf import ExtendedKalmanFilter\n"
        "def tight(vehicle, sensor_noise):\n"
        "    return ExtendedKalmanFilter(vehicle, sensor_noise)\n"
    )
    theirs = simulate(*load("grass", (*SHORT, 'controller.estimator="lawn.watch:tight"')), seed=3)
    ours = simulate(*load("grass", SHORT), seed=3)
    assert theirs[0].tracking == ours[0].tracking
    assert theirs[0].run_id != ours[0].run_id


STAGES = """
def hold(generator, hp, from_s=0.0):
    def stage(setup, tick):
        if tick.now.time_s >= from_s:
            command = tick.command
            tick.command = type(command)(command.delta_t, command.delta_i, hp)
    return stage

def broken(generator):
    def stage(setup, tick):
        raise ValueError("no such valve")
    return stage
"""


def staged(*stages):
    return load("grass", [*SHORT, f"stages=[{', '.join(stages)}]"])


def test_a_scenario_adds_stages_to_the_loop(package):
    (package / "lawn" / "faults.py").write_text(STAGES)
    slow = "{make='lawn.faults:hold', after='control', options={hp=0.4}}"
    _, record = simulate(*staged(slow), seed=1)
    assert record[STATE]["hp_set_point"][-1] == 0.4
    _, untouched = simulate(*load("grass", SHORT), seed=1)
    assert untouched[STATE]["hp"][-1] > 0.6
    summary, _ = simulate(*staged("{make='lawn.faults:broken', after='sense'}"), seed=1)
    assert summary.status == "invalid"
    assert "stage lawn.faults:broken raised at tick 0: ValueError" in summary.failure
    with pytest.raises(InvalidController, match=r"lawn\.faults has no gust"):
        simulate(*staged("{make='lawn.faults:gust', after='sense'}"), seed=1)
    with pytest.raises(ValueError, match="'sens'"):
        with_stages([("sens", lambda setup, tick: None)])


def test_runs_of_a_factory_are_filed_under_its_own_name_and_source(package):
    summary, _ = simulate(*load("grass", SHORT), seed=3, factory=Wild)
    assert summary.controller == f"{__name__}:Wild"
    assert f"controller {summary.controller}" in summary.versions
    shipped, _ = simulate(*load("grass", SHORT), seed=3)
    assert shipped.controller == "ttempc"
    assert shipped.run_id != summary.run_id
    named = (*SHORT, 'controller.name="lawn.drivers:paper"')
    before, _ = simulate(*load("grass", named), seed=3)
    with open(package / "lawn" / "drivers.py", "a") as file:
        file.write("# changed\n")
    still, _ = simulate(*load("grass", named), seed=3)
    assert still.run_id == before.run_id  # the loaded code is that of before
    del sys.modules["lawn.drivers"]
    after, _ = simulate(*load("grass", named), seed=3)
    assert after.run_id != before.run_id


class Wild:
    """Returns a command that no vehicle can follow at tick 2, one that is no number at tick 3."""

    def __init__(self, vehicle, reference, period_s):
        self.inner = make_controller("feedforward", vehicle, reference, period_s)

    def step(self, estimate, k):
        made = self.inner.step(estimate, k)
        commands = {2: Command(9.0, -9.0, 7.0), 3: Command(float("nan"), 0.0, float("inf"))}
        return ControlStep(commands.get(k, made.command), made.diagnostics)


def test_commands_beyond_the_limits_are_cut_and_said():
    summary, record = simulate(*load("grass", SHORT), seed=1, factory=Wild)
    assert summary.status == "completed"
    vehicle, sent = Vehicle(), record[CONTROL].columns("delta_t_rad_command", "hp_command")
    assert np.all(np.abs(sent[:, 0]) <= vehicle.steering_limit_t)
    assert np.all(
        np.abs(np.diff(sent, axis=0)) <= vehicle.input_rate[[Input.DELTA_T, Input.HP]] * 0.2 + 1e-12
    )
    said = [event.text for event in record.events]
    assert any(
        "the controller's delta_t beyond its range, delta_i beyond its range, hp beyond" in text
        for text in said
    )
    assert any("the controller's delta_t not finite, hp not finite: cut" in text for text in said)
    assert any(text == "reaction ended" for text in said)


def test_exits_raise_in_the_threads_of_drives_alone():
    """Two threads enter and leave in another order; each call raises where its thread is inside."""
    inside, leave, said = threading.Barrier(2), threading.Barrier(2), []

    def drive(first):
        with exits_raise():
            inside.wait(5.0)
            if first:
                leave.wait(5.0)
            try:
                os._exit(3)
            except SystemExit as exit:
                said.append(str(exit))
        if not first:
            leave.wait(5.0)

    threads = [threading.Thread(target=drive, args=(first,)) for first in (True, False)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert said == ["os._exit(3)"] * 2
