"""Attacks on what a run stands on: disks, folders, locales, networks, other processes, time.

They are classes of `tests.attacks`, which drives them and prints their table.
"""

import contextlib
import http.server
import itertools
import json
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path

import numpy as np
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import STATE

from tests.attacks import command, each, isolated, row_bits, short, study
from tests.experiments.interfaces.serve import test_session
from tests.experiments.logs.test_import import panda


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Web server that says nothing on stderr."""

    def log_message(self, *words):
        """Nothing."""


ROOT = Path(__file__).resolve().parents[1]
FULL_BYTES = (0, 1, 4096, 20_000, 100_000, 600_000)  # at which the disk is full


def outputs(folder):
    """Return commands that write, each without the place that it writes to."""
    at = short(folder)
    log = folder / "run"
    if not log.exists():
        command("run", at, "-q", "-o", log, codes=(0,))
    return (
        ("run", at, "-q"),
        (*study(folder, "seeds = [1, 2]\n"), "--workers", 0),
        ("render", log, "--at", 1.0),
        ("log", "export", log),
        ("report", log),
        ("mjcf", at),
        ("log", "import", panda(folder / "panda.txt")),
        ("search", "limit", at, "slope", "--seeds", 1, "--workers", 0),
        ("bench", "--draw-seeds"),
    )


def disks(folder):
    """A disk that is full after some bytes of a file: one line, and the same command goes on."""

    def full(words, most, place):
        def limited():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
            command(*words, "-o", place, codes=(0, 2), writes=True)

        failure = isolated(limited)
        assert not failure, failure

    ending = {"render": ".webp", "log": ".mcap", "search": ".json", "bench": ".txt"}
    for k, (words, most) in enumerate(itertools.product(outputs(folder), FULL_BYTES)):
        yield partial(full, words, most, folder / f"full{k}{ending.get(words[0], '')}")


def read_only(folder):
    """A folder in which nothing can be made, as on a read-only disk: one line."""
    places = Path("/proc"), Path("/sys"), Path("/proc/self/fdinfo"), Path("/dev/full")
    for words, place in itertools.product(outputs(folder), places):
        yield partial(command, *words, "-o", place / "new.webp")


def locales(folder):
    """A decimal comma, or an output of ASCII alone: the same figures, exit code 0."""
    at = short(folder)
    subprocess.run(("localedef", "-i", "de_DE", "-f", "UTF-8", folder / "de_DE.UTF-8"), check=False)

    def same(words, settings, place):
        environment = {**os.environ, "LOCPATH": str(folder), **settings}
        line = sys.executable, "-m", "proving_ground.experiments.commands.cli", *map(str, words)
        set_first = "import locale; locale.setlocale(locale.LC_ALL, '')"
        if "LC_ALL" in settings:
            start = f"{set_first}; import runpy; runpy.run_module({line[2]!r}, run_name='__main__')"
            line = sys.executable, "-c", start, *line[3:]
        done = subprocess.run((*line, "-o", place), env=environment, capture_output=True, cwd=ROOT)
        assert done.returncode == 0, done.stderr[-300:]
        if (place / "summary.json").exists():
            first, second = (
                json.loads((one / "summary.json").read_text()) for one in (alone, place)
            )
            assert first["tracking"] == second["tracking"]

    alone = folder / "alone"
    command("run", at, "-q", "-o", alone, codes=(0,))
    comma = {"LC_ALL": "de_DE.UTF-8"}
    plain = {"PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    for name, settings in (("comma", comma), ("ascii", plain)):
        yield partial(same, ("run", at), settings, folder / f"run-{name}")
        yield partial(same, ("log", "export", alone), settings, folder / f"tables-{name}")
        yield partial(same, ("report", alone), settings, folder / f"page-{name}")


def wires(folder):
    """Noise and replays on the wire of a session in lock-step: the same bits as without."""
    plain, *_ = test_session.drive(test_session.follow)
    expected = plain.tables[STATE.topic].values

    def noise(draw):
        size = draw.choice((0, 1, 7, 300, 9000, 65_000))
        return draw.randbytes(size)

    @contextlib.contextmanager
    def strangers(draw, heard, address):
        ended = threading.Event()

        def shout():
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
                while not ended.wait(0.002):
                    again = [draw.choice(heard)] if heard else []
                    for one in (noise(draw), *again):
                        other.sendto(one, address)

        thread = threading.Thread(target=shout, daemon=True)
        thread.start()
        yield
        ended.set()
        thread.join()

    def driven(kind, seed):
        draw = random.Random(seed)
        sent = []

        def answer(datagram):
            made = test_session.follow(datagram)
            sent.extend(made)
            if kind == "noise":
                return [noise(draw) for _ in range(draw.randrange(4))] + made
            if kind == "replay":
                return [draw.choice(sent) for _ in sent[:9]] + made
            return made

        beside = partial(strangers, draw, sent) if kind == "strangers" else None
        record, outcome, *_ = test_session.drive(answer, beside=beside)
        assert outcome.status == "completed", outcome
        np.testing.assert_array_equal(record.tables[STATE.topic].values, expected)

    yield from each(driven, ("noise", "replay", "strangers"), range(6))


def clusters(folder):
    """An address without a scheduler, or workers of other code or none: one line in time."""
    words = study(folder)

    def free_port():
        with socket.create_server(("127.0.0.1", 0)) as free:
            return free.getsockname()[1]

    def refused(address, name):
        begun = time.monotonic()
        command(*words, "--dask", address, "-o", folder / f"to-{name}")
        assert time.monotonic() < begun + 30.0

    def silent(scheme):
        with socket.create_server(("127.0.0.1", 0)) as server:
            refused(f"{scheme}://127.0.0.1:{server.getsockname()[1]}", f"silent-{scheme}")

    def web():
        server = http.server.HTTPServer(("127.0.0.1", 0), Quiet)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        refused(f"tcp://127.0.0.1:{server.server_port}", "web")

    def workers(environment):
        here = f"tcp://127.0.0.1:{(port := free_port())}"
        place = folder / f"workers{len(environment)}"
        place.mkdir()
        with contextlib.ExitStack() as stack:
            for kind, *rest in (
                ("scheduler", "--host", "127.0.0.1", "--port", port),
                ("worker", here, "--nthreads", 1, "--no-nanny"),
            ):
                line = sys.executable, "-m", f"distributed.cli.dask_{kind}", *map(str, rest)
                process = stack.enter_context(
                    subprocess.Popen(
                        (*line, "--no-dashboard"),
                        stderr=subprocess.DEVNULL,
                        env={**os.environ, **environment},
                        cwd=place,
                    )
                )
                stack.callback(process.kill)
                time.sleep(3.0)
            refused(here, f"workers{len(environment)}")

    def other_code():
        copy = folder / "other"
        kept = shutil.ignore_patterns(".*", "runs", "docs")
        shutil.copytree(ROOT, copy, ignore=kept)
        with (copy / "testbed" / "errors.py").open("a") as file:
            file.write("# another version\n")
        workers({"PYTHONPATH": f"{copy / 'packaging'}:{copy}", "OTHER": "1"})

    yield partial(silent, "tcp")
    yield partial(silent, "tls")
    yield web
    yield partial(refused, f"tcp://127.0.0.1:{free_port()}", "nobody")
    yield partial(refused, "tcp://no.such.host.invalid:8786", "no-host")
    yield partial(workers, {"PYTHONPATH": ""})
    yield other_code


def caches(folder):
    """Two processes that compile into one new cache: the same bits as with a cache of its own."""
    at = short(folder)

    def together():
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
        cli = sys.executable, "-m", "proving_ground.experiments.commands.cli", "run", at, "-q", "-o"
        places = [folder / f"both{k}" for k in range(2)]
        begun = [subprocess.Popen((*cli, place), env=environment, cwd=ROOT) for place in places]
        assert [process.wait() for process in begun] == [0, 0]
        command("run", at, "-q", "-o", folder / "alone", codes=(0,))
        made = [
            json.loads((one / "summary.json").read_text()) for one in (*places, folder / "alone")
        ]
        assert made[0]["tracking"] == made[1]["tracking"] == made[2]["tracking"]

    yield together


def deaths(folder):
    """Kill -9 of `bench`, `render` or `log import` at a random moment; the same command again."""
    at = short(folder)
    command("run", at, "-q", "-o", folder / "run", codes=(0,))
    record = panda(folder / "panda.txt")
    bench = "bench", "feedforward", "--quick", "--workers", 0

    def killed(words, place, after_s):
        isolated(partial(command, *words, "-o", place, codes=(0,)), after_s)
        if words[0] == "bench" or not place.exists():
            command(*words, "-o", place, codes=(0,))
        assert place.exists()
        assert not [*place.parent.glob(f"{place.name}.part")]
        if words[0] == "bench":
            assert row_bits(place) == row_bits(folder / "bench")

    for words, ending, most_s in (
        (("render", folder / "run"), ".webp", 4.0),
        (("log", "import", record), ".mcap", 1.0),
    ):
        for k in range(10):
            after_s = random.Random(k).uniform(0.01, most_s)
            yield partial(killed, words, folder / f"{words[0]}{k}{ending}", after_s)
    command(*bench, "-o", folder / "bench", codes=(0,))
    for k in range(4):
        yield partial(killed, bench, folder / f"bench{k}", random.Random(k).uniform(0.5, 20.0))


def soak(folder):
    """Runs of 6 and 24 simulated hours: each completes, and its memory has an end."""
    laps = ("path.laps=100", "path.speed_mps=0.6")  # as many as a path may have
    large = ("path.radius_m=40.0", "path.centre_distance_m=125.0")
    field = ("terrain.size_x_m=250.0", "terrain.size_y_m=130.0")

    def driven(changes, hours, most_mb):
        summary, record = simulate(*load("grass", changes), 4999)
        assert summary.status == "completed", summary.failure
        assert record[STATE].time_s[-1] > hours * 3600.0, record[STATE].time_s[-1]
        peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
        assert peak_mb < most_mb, peak_mb

    yield partial(driven, laps, 6.0, 900.0)
    yield partial(driven, (*laps, *large, *field), 24.0, 3000.0)


CLASSES = (disks, read_only, locales, wires, clusters, caches, deaths, soak)
