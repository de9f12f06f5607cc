"""Attacks by class, each in a process of its own, and a table of their counts.

    python -m tests.attacks [CLASS[=N] ...]

N drives as many attacks of a class, drawn with a fixed seed, instead of all. An attack has failed
where an exception escapes, a refusal is not one line with exit code 2, code runs that nobody
trusted, memory or time has no bound, or a result is not that of a run left alone.
"""

import argparse
import contextlib
import copy
import io
import json
import math
import os
import random
import re
import resource
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import count, permutations, product
from pathlib import Path

import numpy as np
import pytest
from gymnasium.error import Error
from proving_ground.experiments.commands.cli import main as ttempc
from proving_ground.experiments.errors import ExperimentError
from proving_ground.experiments.interfaces.gym_env.environment import FieldTrial
from proving_ground.experiments.interfaces.serve.agopengps import AgOpenGpsProtocol, Dialect, frame
from proving_ground.experiments.interfaces.serve.session import SessionSettings
from proving_ground.experiments.papers.markdown import markdown
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.studies.sweep.results import rows
from proving_ground.testbed.errors import TestbedError
from proving_ground.testbed.log.model_whitelist import check_model
from proving_ground.testbed.log.reader import message_class, read_content, row_fields
from proving_ground.testbed.log.writer import begin_log
from proving_ground.testbed.recording import channels as ch

from tests.experiments.interfaces.serve import test_session
from tests.experiments.interfaces.serve.test_agopengps import steering_frame
from tests.experiments.score_cards import card_of, scored
from tests.testbed.log import test_log_integrity
from ttempc import Guidance, GuidanceSettings, Measurement, Sensor, Vehicle, figure_eight
from ttempc.errors import TtempcError

STRAIGHT = "kind = 'straight'\nlength_m = 2.0\n"  # keys of a table of the path
LIMIT_S, LIMIT_BYTES, MOST_LAP_MB = 300.0, 8 * 2**30, 2.0
LIMITS_S = {"soak": 7200.0}  # of classes whose attacks are longer
SEEDS = "seeds = [1, 2, 3, 4, 5, 6]\n"
COMMANDS = "delta_t_rad_command", "delta_i_rad_command", "hp_command"
NUMBERS = (math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 0.0, -1.0, 1e9)
NONSENSE = (None, "", "a", "nan", b"x", 10**400, *NUMBERS, 1j, True, (), [1.0], {}, object())
NONSENSE += np.float32(3.0), np.array(3.0), np.zeros(3), np.zeros((3, 1)), np.array(["a"])


def command(*words, codes=(2,), writes=False):
    """Fail where a call of the command line does; a refused one writes nothing."""
    said = io.StringIO()
    out = Path(words[words.index("-o") + 1]) if "-o" in words else Path("/")
    before = out.exists()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            code = ttempc([*map(str, words)])
        except SystemExit as end:  # argparse's way out
            code = end.code
    wrong = code not in codes or (code == 2 and said.getvalue().count("\n") != 1)
    wrong |= code == 2 and not writes and out.exists() != before
    assert not wrong, f"{words}: exit code {code}, {said.getvalue()[:300]!r}"


def isolated(attack, limit_s=LIMIT_S, delay_s=0.0):
    """Return how an attack failed in a forked process, which is killed after the limit."""
    inlet, outlet = os.pipe()
    if not (child := os.fork()):
        try:
            resource.setrlimit(resource.RLIMIT_AS, (LIMIT_BYTES, LIMIT_BYTES))
            time.sleep(delay_s)
            failure = attack() or "-"
        except BaseException as error:
            failure = f"{type(error).__name__}: {error} of {attack}"
        os.write(outlet, failure.encode()[:4000])
        os._exit(0)
    os.close(outlet)
    ready, _, _ = select.select([inlet], [], [], limit_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    failure = os.read(inlet, 4000).decode(errors="replace") or "died" if ready else "no end"
    os.close(inlet)
    return failure.removeprefix("-")


def each(attack, *choices):
    """Yield an attack for each combination of choices."""
    yield from (partial(attack, *case) for case in product(*choices))


def written(folder, data, ending=".toml"):
    file = folder / f"{len([*folder.iterdir()])}{ending}"
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    return file


def short(folder, text=""):
    return written(folder, f"[path]\n{STRAIGHT}{text}")


def study(folder, text=SEEDS):
    text = f"scenario = 'pavement'\n{text}[set.path]\n{STRAIGHT}"
    return "sweep", written(folder, text), "-q"


def unlearning_guidance(controller):
    """Return a guidance along the figure eight whose model stays as it is."""
    settings = GuidanceSettings(learn=False)
    return Guidance(Vehicle(), figure_eight(), controller=controller, settings=settings)


def same_in_threads(drive, cases):
    """Fail where drives in threads have other bits than one after another."""
    with ThreadPoolExecutor(len(cases)) as pool:
        made = [*pool.map(drive, cases)]
    assert made == [*map(drive, cases)], cases


def row_bits(place):
    made = sorted(rows(place / "results.jsonl"), key=lambda row: str(row["run"]))
    cost = "wall_s", "timing.", "attempts"
    return [json.dumps({k: row[k] for k in row if not k.startswith(cost)}) for row in made]


def samples(folder):
    """A time, a sample or a part of one that is none, at the seventh of 12 ticks."""

    def good(t):
        positions = (Sensor.GNSS_TRACTOR, (t, 0.0)), (Sensor.GNSS_TRAILER, (t - 5.0, 0.0))
        angles = Sensor.STEERING_TRACTOR, Sensor.STEERING_TRAILER, Sensor.HITCH
        values = *positions, (Sensor.ENCODER, (1.0,)), *((angle, (0.0,)) for angle in angles)
        return [Measurement(t, sensor, value) for sensor, value in values]

    def seventh(part, wrong, t):
        whole = Measurement(t, Sensor.GNSS_TRACTOR, (t, 0.0))
        parts = {"time": good(t), "samples": wrong, "sample": [wrong]}
        parts["entry"] = [replace(whole, value=(t, wrong))]
        parts["swapped"] = [Measurement(wrong, t, (0.0,))]
        return parts[part] if part in parts else [replace(whole, **{part: wrong})]

    def drive(made, part, wrong):
        guidance = copy.deepcopy(made)
        for k in range(12):
            now = 0.2 * k
            with contextlib.suppress(*((TtempcError,) if k == 6 else ())):
                if k == 6:
                    guidance.update(wrong if part == "time" else now, seventh(part, wrong, now))
                elif k < 6 or part != "time":  # a time that was taken is that of the clock
                    guidance.update(now, good(now))
                assert np.isfinite(guidance.step().as_array()).all(), (part, wrong)

    parts = "time", "samples", "sample", "entry", "status", "swapped", "time_s", "sensor", "value"
    for name in ("ttempc", "pid"):
        made = Guidance(
            Vehicle(), figure_eight(), controller=name, settings=GuidanceSettings(learn=False)
        )
        yield from each(drive, [made], parts, NONSENSE)


def gym(folder):
    """An argument, seed, option or action of the environment; environments beside each other."""
    path = "path={kind='straight', length_m=3}", "controller.name='pid'"

    def refused(call, *errors):
        try:
            return call()
        except (ExperimentError, TestbedError, TtempcError, Error, *errors) as error:
            if "\n" in str(error):
                raise
            return None

    def settings(key, wrong):
        refused(lambda: FieldTrial(**{"scenario": "pavement", "overrides": path, key: wrong}))

    def seen(environment, seed=3):
        draw = np.random.default_rng(seed)
        yield environment.reset(seed=seed)[0].tobytes()
        for _ in range(9):
            yield environment.step(draw.uniform(-0.5, 0.5, 3))[0].tobytes()

    def resets(wrong):
        environment = FieldTrial("pavement", path)
        with pytest.raises(Error):  # before the start
            environment.step(np.zeros(3))
        for words in ({"seed": wrong}, {"seed": 1, "options": wrong}):
            answer = refused(partial(environment.reset, **words))
            assert answer is None or np.isfinite(answer[0]).all()
        assert [*seen(environment)] == [*seen(FieldTrial("pavement", path))]

    def actions(mode, wrong, periods):
        environment, other = (FieldTrial("pavement", path, **mode) for _ in range(2))
        environment.reset(seed=5)
        for _ in range(periods):
            if (answer := refused(lambda: environment.step(wrong), ValueError)) is not None:
                assert np.isfinite(answer[0]).all() and math.isfinite(answer[1])  # noqa: PT018
                assert environment.observation_space.contains(answer[0])
                if answer[2] or answer[3]:
                    with pytest.raises(Error):
                        environment.step(np.zeros(3))
                    break
        assert [*seen(environment)] == [*seen(other)]

    def grass(seed):
        return [*seen(FieldTrial("grass", path), seed)]

    def in_turn(seeds):  # a step of each
        made, alone = [FieldTrial("grass", path) for _ in seeds], map(grass, seeds)
        assert [*zip(*map(seen, made, seeds), strict=True)] == [*zip(*alone, strict=True)]

    keys = "scenario", "overrides", "action", "normalised", "residual_share", "trust", "render_mode"
    yield from each(settings, keys, NONSENSE)
    lines = "x", "x=1", "path.laps=1e999", "controller.name='os:system'", "path={kind='no'}"
    yield from each(settings, ["overrides"], [[line] for line in lines])
    more = 2**32, 2**32 - 1, -(2**40), 1.5, np.int64(3), np.uint32(4), np.bool_(True), -0.0
    yield from each(resets, (*NONSENSE, *more))
    own = [np.full(3, value) for value in (*NUMBERS, 1.0)] + [np.zeros(2), np.zeros(4), ["a"] * 3]
    own += [[None] * 3, [1, 2, 10**400], np.zeros(3, complex), np.ones(3, bool), [[1], [2], [3]]]
    yield from each(actions, [{}], NONSENSE, [3])
    yield from each(actions, ({}, {"normalised": False}, {"action": "residual"}), own, [400])
    for attack in (in_turn, partial(same_in_threads, grass)):
        yield from each(attack, [range(2), range(4), range(6)])


def options(folder):
    """A word or number of `search` and `serve`, a controller, file of seeds or card of `bench`."""
    at, out = short(folder), ("-o", folder / "out")
    words = """= == x x=1 x=1:2 path=0:1 .=0:1 path.kind=1:2 seeds=1:2 controller=0:1
        stages.make=0:1 faults.gust.force_n=1:2 path.laps=1:2.5 slope:free plant.vehicle.file=0:1
        scenario=0:1 path.length_m=1e9:1e10 path.speed_mps= path.speed_mps=1 path.speed_mps=2:1
        path.speed_mps=nan:1 path.speed_mps=1:inf path.speed_mps=1:1e999 path.speed_mps=1:2:3
        path.speed_mps=-1e308:1e308"""
    quantities = *words.split(), "", "\0=0:1", "a" * 9999
    for action, word in product(("limit", "rays"), quantities):
        yield partial(command, "search", action, at, word, *out, "--workers", 0)
    texts = "-1", "x", "nan", "inf", "1e999", "", "9" * 400
    for words, values in (
        (("search", "limit", at, "slope", "--seeds"), ("0", "1001", *texts)),
        (("search", "limit", at, "slope", "--workers"), ("1001", *texts)),
        (("search", "rays", at, "slope", "--rays"), ("0", "10001", *texts)),
        (("search", "limit", at, "slope", "--limit"), ("0", "1e7", *texts)),
        *((("serve", at, "--port", 0, f"--{one}"), ("0", "1e-300", "1e300", *texts))
          for one in ("wait", "hold", "speed")),
        (("bench", "--quick"), ("", "nobody", "a:b", "pid:", ":", "json:no")),
    ):  # fmt: skip
        yield from (partial(command, *words, value, *out) for value in values)
    for where in ("nope", folder, "/dev/null", "/dev/zero/x"):
        yield partial(command, "search", "limit", where, "slope", *out)
    card = folder / "card.json"
    card.write_text(card_of([[0.05] * 20] * len(scored()), "pid").to_json())
    files = b"", b"x", b"1 1", b"-1", b"1e3", b"9" * 20, b"\xff" * 99, b"1\0", b"0 " * 2000, b"[]"
    for data in (*files, *(card.read_bytes()[:n] for n in range(40, 4000, 200))):
        file = written(folder, data, ".txt")
        yield partial(command, "bench", "pid", "--seeds-file", file, *out)
        yield partial(command, "bench", "--compare", card, file)
    for k in range(60):
        draw = random.Random(k)
        table = place = json.loads(card.read_text())
        while isinstance(place[key := draw.choice([*place])], dict) and place[key]:
            place = place[key]
        place[key] = draw.choice((None, -1, math.nan, 1e999, "x", [], {}, [[]], 10**30, True))
        file = written(folder, json.dumps(table), ".json")
        yield partial(command, "bench", "--compare", card, file, codes=(0, 2))

    def twice(words):
        first, second = (folder / f"{words[0]}{k}.json" for k in (1, 2))
        search = "search", "limit", at, *words, "--seeds", 1, "--workers", 0, "-o"
        for file in (first, second):
            command(*search, file, codes=(0,))
        text = first.read_text()
        command(*search, first)  # and it stays as it is
        assert text == first.read_text() == second.read_text()
        assert "NaN" not in text

    yield from each(twice, (("slope",), ("delay", "--controller", "pid"), ("path.length_m=1:3",)))


def maps(folder):
    """A file of heights or of soil strength: none, of wrong shape, NaN, huge, one to sink in."""
    head = b"\x93NUMPY\x01\x00v\x00{'descr': '<f8', 'fortran_order': False, 'shape': (%s), }"
    wrong = [b"", b"x", b"1 2\n3", b"1,,2", b"\xff" * 99, b"1e999 1\n1 1", b"\x93NUMPY", b"1 2\n"]
    wrong += [head % size for size in (b"99999, 99999", b"-1, 4", b"(" * 99, b"0, 2**62")]
    wrong += [b"1 " * 9 + b"\n" + b"nan " * 9, b"1;2\n3;4", b"\0", b"1 2\r3 4\x0c5"]
    wrong += [b"# all of it\n", b"0x10 1\n1 1", b"1_0 1 1\n1 1"]
    wrong += [np.zeros(shape) for shape in ((0, 0), (1, 1), (3,), (2, 2, 2), (1, 9), (9, 1))]
    wrong += [np.full((9, 9), value) for value in (math.nan, math.inf, -math.inf)]
    wrong += [np.array([["a"] * 9] * 9), np.array([[None] * 9] * 9, object), np.eye(9) * 1j]
    wide = [np.full((200, 200), value) for value in (0.0, 1e300, -1e300, -5.0, 1e4, 5e-324)]
    wide += [np.random.default_rng(1).normal(0.0, size, (200, 200)) for size in (3.0, 1e3, 1e150)]
    wide += [np.tile([0.0, 20.0], (200, 100)), np.zeros((200, 200), np.int8), np.ones((30, 900))]
    wide += [np.asfortranarray(np.ones((200, 200))), np.ones((200, 200), ">f4")]
    kinds = "terrain={{height_map='{}',spacing_m={}}}", "soil.map={{file='{}',spacing_m={}}}"
    at, out = short(folder), ("-o", folder / "out")
    for (k, data), ending in product(enumerate((*wrong, *wide)), (".npy", ".csv")):
        file = folder / f"{k}{ending}"
        if isinstance(data, bytes):
            file.write_bytes(data)
        elif ending == ".npy":
            np.save(file, data, allow_pickle=True)
        elif data.dtype.kind in "fi" and data.ndim < 3:
            np.savetxt(file, data)
        else:
            continue
        codes = (2,) if k < len(wrong) else (0, 1, 2, 3)
        for n, key in enumerate(kinds):
            words = "-q", "--set", key.format(file, 0.5), "-o", folder / f"{k}{ending}{n}"
            yield partial(command, "run", at, *words, codes=codes)
    flat, spacings = folder / f"{len(wrong)}.npy", "nan inf -1 0 1e-300 1e300 'x' []"
    odd = folder, "/dev/zero", "/dev/null", "no/such", "a\\u0000b", "x" * 5000, "http://a/b.npy"
    cases = [*product([flat], spacings.split()), *product(odd, [0.5])]
    for case, key in product(cases, kinds):
        yield partial(command, "run", at, "--set", key.format(*case), *out)


def logs(folder):
    """The log of a lap with other values, rows, times, bits, attachments: fit, replay, check."""
    words = "run", "grass", "--set", "path.laps=1", "--seed", 9921, "-q", "-o"
    isolated(partial(command, *words, folder / "run", codes=(0,)))
    whole = (folder / "run" / "log.mcap").read_bytes()
    content = read_content(folder / "run" / "log.mcap")
    found = {topic: [one.data for one in known] for topic, known in content.messages.items()}
    kinds = [ch.MEASUREMENT, ch.ESTIMATE, ch.CONTROL, ch.REFERENCE, ch.STATE]

    def write(file, attachments=(), messages=()):
        with file.open("wb") as stream:
            made = {**content.attachments, **dict(attachments)}
            log, numbers = begin_log(stream, content.metadata, made, content.topics.values())
            for topic, data in {**found, **dict(messages)}.items():
                times = [message.log_time for message in content.messages[topic]]
                for k, one in enumerate(data):
                    stamp = np.array([times[min(k, len(times) - 1)]])
                    log.add(numbers[topic], stamp, np.frombuffer(one, np.uint8)[None])
            log.finish()

    def read(file, check=(0, 1, 2)):
        begun, out = time.process_time(), file.with_suffix(".json")
        command("fit", "tube", file, file, file, "-o", out, codes=(0, 1, 2))
        command("log", "replay", file, codes=(0, 1, 2))
        command("log", "check", file, codes=check)
        assert not out.exists() or "NaN" not in out.read_text(), "NaN in the tube"
        assert time.process_time() < begun + 60.0

    def fuzz(kind, seed):
        draw, numbers = random.Random(seed), np.random.default_rng(seed)
        at, file = draw.choice(kinds), folder / f"{kind}{seed}.mcap"
        message, names = message_class(at), row_fields(at)
        known = map(message.FromString, found[at.topic])
        rows = np.array([[getattr(one, name) for name in names] for one in known])
        (n, width), odd = rows.shape, draw.choice(NUMBERS)
        t, body, line, column = rows[:, :1], rows[:, 1:], *np.indices(rows.shape)
        noise = draw.choice((0.1, 1e6, 1e300)) * numbers.normal(size=body.shape)
        few = numbers.random(rows.shape) < draw.choice((1e-3, 0.1))
        with np.errstate(all="ignore"):
            rows = {
                "column": np.where(column == draw.randrange(width), odd, rows),
                "cells": np.where(few, odd, rows),
                "rest": np.where(line >= draw.randrange(n), odd, rows),
                "noise": np.hstack([t, body + noise]),
                "scale": np.hstack([t, body * draw.choice((0.0, -1.0, 1e6, 1e-9, 1e300))]),
                "times": np.hstack([draw.choice((0 * t, 1e12 * t, -t, t[::-1], t + 1e18)), body]),
                "shuffle": numbers.permutation(rows),
                "same": np.tile(rows[n // 2], (n, 1)),
                "cut": rows[: draw.choice((0, 1, 2, 10, n // 3))],
                "thin": rows[:: draw.choice((2, 7, 100))],
                "back": rows[::-1],
            }[kind]
            made = [dict(zip(names, row, strict=True)) for row in rows.tolist()]
            write(file, (), {at.topic: [message(**row).SerializeToString() for row in made]})
            read(file)

    def flipped(seed):
        draw, data = random.Random(seed), bytearray(whole)
        for _ in range(draw.choice((1, 30, 1000))):
            data[draw.randrange(len(data))] ^= 1 << draw.randrange(8)
        end = draw.choice((len(data), draw.randrange(len(data))))
        (file := folder / f"flip{seed}.mcap").write_bytes(data[:end])
        read(file, check=(1, 2))

    def damaged(attachments, messages):
        write(folder / "damaged.mcap", attachments, messages)
        read(folder / "damaged.mcap", check=(1, 2))

    names = "column", "cells", "rest", "noise", "scale", "times"
    yield from each(fuzz, (*names, "shuffle", "same", "cut", "thin", "back"), range(6))
    yield from each(flipped, range(40))
    texts = b"", b"x = 1", b"\xff\xfe", b"<mujoco><include file='/etc/passwd'/></mujoco>"
    others = [{name: text} for name, text in product(content.attachments, texts)]
    yield from each(damaged, others, [{}])
    changes = [lambda data: [], lambda data: data[:3], lambda data: data[::2]]
    changes += [lambda data: [b""] * len(data), lambda data: [b"\xff\x01"] * len(data)]
    topics = "/tf", "/state", "/reference", "/control", "/estimate"
    others = [{topic: change(found[topic])} for topic, change in product(topics, changes)]
    yield from each(damaged, [{}], others)


def models(folder):
    """A model in a log that asks for gigabytes, files or minutes."""

    def refused(inside):
        with pytest.raises(ValueError):  # noqa: PT011 - what else escapes is no refusal
            check_model(f"<mujoco>{inside}</mujoco>")

    yield from each(refused, test_log_integrity.WRONG_MODELS)


def trust(folder):
    """A scenario or study that names code in this folder, without `--trust`: it does not run."""
    (folder / "evil.py").write_text("from pathlib import Path\nPath('MARK').touch()\nmake = None")
    out, alone = ("-o", folder / "out"), ("--workers", 0)

    def untouched(*words):
        os.chdir(folder)
        sys.path.insert(0, str(folder))
        command(*words)
        assert not Path("MARK").exists(), "imported"

    stage, name = "[[stages]]\nmake = 'evil:make'\nafter = ", "[controller]\nname = "
    estimator = "[controller]\nestimator = 'evil:make'\n"
    parts = [f"{stage}'{one}'\n" for one in ("sense", "estimate", "control", "advance", "nope")]
    parts += [f"{stage}'control'\n{stage}'advance'\n", f"{stage}'sense'\noptions = {{a = 1}}\n"]
    parts += [f"{name}'evil:make'\n", f"{name}'os:system'\n", f"{name}''' evil:make'''\n"]
    parts += [f"{name}'''evil:make\nx'''\n", f'{name}"evil:make\\u0000"\n', estimator]
    axis = "[[axis]]\nkind = 'list'\nkey = '{}'\nvalues = ['{}', '{}']\n"
    plain = "scenario = 'pavement'\n"
    for text in parts:
        scenario = short(folder, text)
        for word in ("run", "serve", "validate", "mjcf"):
            yield partial(untouched, word, scenario, *out)
        for action in ("rays", "limit"):
            yield partial(untouched, "search", action, scenario, "slope", *out, *alone)
        named = plain + axis.format("scenario", "pavement", scenario)
        inside = plain + re.sub(r"\[(controller|stages)\]", r"[set.\1]", text)
        for lines in (f"scenario = '{scenario}'\n", named, inside):
            sweep = partial(untouched, "sweep", written(folder, lines), *out)
            yield from (partial(sweep, *more) for more in (alone, ("--dry-run",)))
    keys = "controller controller.estimator controller.name stages stages.make stages.0.make"
    codes, skips = ("evil:make", "os:system"), ("", "skip_refused = true\n")
    for key, code, more in product(keys.split(), codes, skips):
        file = written(folder, f"{plain}{more}{axis.format(key, 'ttempc', code)}")
        yield partial(untouched, "sweep", file, *out, *alone)


def kills(folder):
    """A sweep of six runs killed at a random moment, with and without logs, and continued."""

    def killed(words, alone, after_s):
        out = alone.parent / f"killed{after_s}"
        isolated(partial(command, *words, out, codes=(0,)), after_s)
        command(*words, out, codes=(0,))
        names = [sorted(file.name for file in (one / "logs").glob("*")) for one in (out, alone)]
        assert (names[0], row_bits(out)) == (names[1], row_bits(alone)), after_s
        for name in names[0]:
            command("log", "check", out / "logs" / name, codes=(0,))

    for number, workers, keep in ((100, 0, ""), (40, 0, "keep = 'all'\n"), (20, 2, "")):
        (place := folder / str(number)).mkdir()
        words = *study(place, SEEDS + keep), "--workers", workers, "-o"
        for name in ("first", "alone"):  # the first loads what all others need
            begun = time.monotonic()
            command(*words, place / name, codes=(0,))
        takes_s = time.monotonic() - begun
        moments = [random.Random(seed).uniform(0.0, takes_s) for seed in range(number)]
        yield from each(killed, [words], [place / "alone"], moments)


def crowds(folder):
    """Runs and sweeps into one folder at once: one is made, the others are refused."""
    one = "run", short(folder), "-q"
    many = *study(folder, "seeds = [1, 2]\nkeep = 'all'\n"), "--workers", 0
    command(*many, "-o", folder / "alone", codes=(0,))

    def together(kinds, place, delays):
        attacks = [partial(command, *words, "-o", place, codes=(0,)) for words in kinds]
        with ThreadPoolExecutor(len(kinds)) as pool:
            said = [*pool.map(isolated, attacks, [LIMIT_S] * len(kinds), delays)]
        made, rest = said.count(""), "".join(said)
        assert rest.count("exit code 2") == rest.count("\\n") == len(said) - made, said
        assert made == 1 or (made > 1 and one not in kinds), said
        if (place / "results.jsonl").exists():
            assert row_bits(place) == row_bits(folder / "alone")
        else:
            command("log", "check", place, codes=(0,))

    for k, kinds in enumerate(((one,) * 2, (one,) * 3, (one, many), (many,) * 2, (many,) * 3) * 6):
        draw = random.Random(k)
        delays = [draw.choice((0.0, draw.uniform(0.0, 1.0))) for _ in kinds]
        yield partial(together, kinds, folder / f"out{k}", delays)


def dask(folder):
    """A scheduler killed or ended in a sweep: rows or a line, and continued it has all rows."""

    def dies(how, wanted, worker_too):
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = str(free.getsockname()[1])
        here, place = f"tcp://127.0.0.1:{port}", folder / f"{how}{wanted}{worker_too}"
        words, made = (*plan, "--dask", here, "-o", place), place / "results.jsonl"
        scheduler = "scheduler", "--host", "127.0.0.1", "--port", port
        worker = "worker", here, "--nthreads", "1", "--no-nanny"

        def start(stack, kind, *rest):
            line = sys.executable, "-m", f"distributed.cli.dask_{kind}", *rest, "--no-dashboard"
            process = stack.enter_context(subprocess.Popen(line, stderr=subprocess.DEVNULL))
            stack.callback(process.kill)
            time.sleep(3.0)
            return process

        with contextlib.ExitStack() as stack, ThreadPoolExecutor(1) as pool:
            head, hand = start(stack, *scheduler), start(stack, *worker)
            said = pool.submit(isolated, partial(command, *words, codes=(0, 2), writes=True))
            while not said.done() and not (made.exists() and len([*rows(made)]) >= wanted):
                time.sleep(0.02)
            head.send_signal(signal.SIGTERM if how == "ended" else signal.SIGKILL)
            head.wait()
            if worker_too:
                hand.kill()
            if how == "returns":
                start(stack, *scheduler)
            assert not said.result(), said.result()
        with contextlib.ExitStack() as stack:
            _ = start(stack, *scheduler), start(stack, *worker)
            command(*words, codes=(0,))
        assert row_bits(place) == row_bits(folder / "alone")

    plan = study(folder)
    command(*plan, "--workers", 0, "-o", folder / "alone", codes=(0,))
    yield from each(dies, ("killed", "ended", "returns"), (0, 2, 5), (False, True))


def peers(folder):
    """Strangers beside AgOpenGPS, and frames of the peer itself that are none or steer nowhere."""
    off = steering_frame(0.0, False)

    def driven(beside=None, change=lambda k, made: made, **pace):
        line, ticks = test_session.AgOpenGps(0.1), count()
        return test_session.drive(
            lambda datagram: change(next(ticks), line(datagram)),
            AgOpenGpsProtocol(Dialect.AGOPENGPS), first=(off,), beside=beside,
            settings=SessionSettings(wait_s=5.0, **pace or {"lockstep": True}),
        )  # fmt: skip

    def squatted(payloads, sockets, again):
        @contextlib.contextmanager
        def beside(address):
            others = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(sockets)]
            _ = [other.sendto(one, address) for other in others for one in payloads * again]
            yield others

        _, outcome, *_ = driven(beside)
        assert outcome.status == "completed", (payloads[0][:9], outcome)

    def own(change, endings, **pace):
        record, outcome, *_ = driven(change=change, **pace)
        assert np.isfinite(record[ch.CONTROL].columns(*COMMANDS)).all()
        assert outcome.status in endings, outcome

    def mixed(payload, every, k, made):
        return [payload] * (k % every == 0) + made

    frames = [b"", b"\x80", b"\x80\x81", b"x" * 60_000, b"\x80\x81\x7f\xfe\xff" + bytes(9)]
    for number in (123, 200, 202, 253, 214, 254):
        frames += frame(0x7F, number, b""), frame(0x7B, number, bytes(8))
    frames += off[:-1], off, test_session.HELLO
    for one in frames:
        yield partial(squatted, [one], 1, 1)
        yield partial(squatted, [one], 12, 3)
        yield partial(own, partial(mixed, one, 1), ("completed",))
    yield partial(squatted, frames[:-1], 30, 30)
    locks = [steering_frame(angle, True) for angle in (-327.0, 327.0, 90.0, -90.0)]
    for lock, every in product(locks, (7, 1)):  # on the clock: the first frame starts the run
        yield partial(own, partial(mixed, lock, every), ("completed", "stopped", "lost"), speed=8.0)
    for after in (12, 20, 40):  # it lets go
        yield partial(own, lambda k, made, n=after: made if k < n else [off], ("invalid",))


def threads(folder):
    """Guidances or simulations in threads: they have the same bits as alone."""

    def commands(controller):
        keys = "path={kind='straight', length_m=6.0}", f"controller.name='{controller}'"
        return simulate(*load("pavement", keys), 1)[1][ch.CONTROL].values.tobytes()

    def guided(name):
        guidance, made = (
            Guidance(
                Vehicle(), figure_eight(), controller=name, settings=GuidanceSettings(learn=False)
            ),
            [],
        )
        for k in range(100):
            t, noise = 0.2 * k, 0.02 * math.sin(k * k)
            values = (Sensor.GNSS_TRACTOR, (t, noise)), (Sensor.ENCODER, (1.0,))
            guidance.update(t, [Measurement(t, *value) for value in values])
            made.append(guidance.step().as_array().tobytes())
        return made

    kinds = "ttempc", "pid", "lqr", "nmpc"
    yield from each(same_in_threads, [commands], permutations(("ttempc-nominal", *kinds[:3])))
    many = *((kind,) * 6 for kind in kinds), *permutations(kinds)
    yield from each(same_in_threads, [guided], many)


def memory(folder):
    """Laps 7 to 30 of a run, or runs: what each adds to the peak of the memory, after warm-up."""

    def peak(laps, runs):
        for _ in range(runs):
            simulate(*load("grass", (f"path.laps={laps}",)), 7)
        return str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0)

    def grows(first, second):
        less, more = (float(isolated(partial(peak, *runs))) for runs in (first, second))
        a_lap = (more - less) / (math.prod(second) - math.prod(first))
        assert a_lap <= MOST_LAP_MB, f"{a_lap:.2f} MB a lap"

    yield from (partial(grows, (6, 1), (30, 1)), partial(grows, (1, 6), (1, 30)))


CLASSES = (samples, gym, options, maps, logs, models, trust, kills, crowds, dask, peers, threads)
CLASSES += (memory,)


def all_classes():
    """Return every class of attacks by its name, those on disks, networks and processes last."""
    from tests import system_attacks  # it needs this module

    return {one.__name__: one for one in (*CLASSES, *system_attacks.CLASSES)}


def chosen(words):
    """Return names and numbers of the classes to drive; exit with one line on any other word."""
    known = all_classes()
    parser = argparse.ArgumentParser(prog="tests.attacks", description=__doc__.splitlines()[0])
    parser.add_argument("words", nargs="*", metavar="CLASS[=N]", help=", ".join(known))
    parts = [word.partition("=") for word in parser.parse_args(words).words or known]
    for name, equals, number in parts:
        if name not in known:
            parser.error(f"{name!r} is none of {', '.join(known)}")
        if equals and not number.isdecimal():
            parser.error(f"{name}={number}: must be a number of attacks")
    return [(name, known[name], number) for name, _, number in parts]


def main(words):
    """Attack and print a table; return 1 where anything failed."""
    lines = []
    for name, attacks_of, number in chosen(words):
        begun = time.monotonic()
        with tempfile.TemporaryDirectory() as place:
            attacks = [*attacks_of(Path(place))]
            if number:
                attacks = random.Random(1).sample(attacks, min(int(number), len(attacks)))
            limit_s = LIMITS_S.get(name, LIMIT_S)
            failures = [isolated(attack, limit_s) for attack in attacks]
        wrong = [f"{name} {time.monotonic() - begun:.0f} s", *filter(None, failures)]
        lines.append((name, str(len(failures)), str(len(wrong) - 1)))
        print(*wrong, sep="\n", file=sys.stderr)
    print(markdown(("class", "attacks", "failures"), lines))
    return int(any(failed != "0" for *_, failed in lines))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
