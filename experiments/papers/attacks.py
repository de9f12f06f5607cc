"""Attacks by files, code, crowds, threads and kill -9, each in a process of its own, by class.

    python -m proving_ground.experiments.papers.attacks

An attack has failed where an exception escapes, a refusal is not one line with exit code 2, or a
sweep that was killed and continued, or a run beside others, has other numbers than one left alone.
"""

import contextlib
import io
import json
import os
import random
import select
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import permutations
from pathlib import Path
from typing import Final

from ...testbed.recording.channels import CONTROL
from ..commands.cli import main as ttempc
from ..run.simulate import simulate
from ..scenario.scenario import load
from ..sweep.results import rows
from .pages import ROOT
from .tables import markdown

Attack = Callable[[], str | None]  # returns how it failed
CARD: Final = ROOT / "docs" / "field-trials" / "pid.json"
FILES: Final = (b"", b"x", b"1 2\n3", b"1,,2", b"\xff" * 99, b"1e999 1\n1 1", b"\x93NUMPY", b"[]")
STRAIGHT: Final = "kind = 'straight'\nlength_m = 2.0\n"  # keys of a table of the path


def command(*words: object, codes: tuple[int, ...] = (2,)) -> str | None:
    """Return how a call of the command line failed."""
    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        try:
            code = ttempc([*map(str, words)])
        except SystemExit as end:  # argparse's way out
            code = end.code
    wrong = code not in codes or (code == 2 and said.getvalue().count("\n") != 1)
    return f"{words}: exit code {code}, {said.getvalue()[:200]!r}" if wrong else None


def isolated(attack: Attack, limit_s: float = 300.0) -> str:
    """Return how an attack failed in a forked process, which is killed after the limit."""
    inlet, outlet = os.pipe()
    if not (child := os.fork()):
        try:
            failure = attack() or "-"
        except BaseException as error:
            failure = f"{type(error).__name__}: {error}"
        os.write(outlet, failure.encode()[:4000])
        os._exit(0)
    os.close(outlet)
    ready, _, _ = select.select([inlet], [], [], limit_s)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    failure = os.read(inlet, 4000).decode(errors="replace") or "died" if ready else "no end"
    os.close(inlet)
    return failure.removeprefix("-")


def files(folder: Path) -> Iterator[Attack]:
    """Maps, score cards, files of seeds and logs that are none."""
    scenario, out = folder / "short.toml", ("-o", folder / "out")
    scenario.write_text(f"[path]\n{STRAIGHT}")
    for k, data in enumerate((*FILES, *(CARD.read_bytes()[:n] for n in range(40, 4000, 200)))):
        for file in (folder / f"{k}.npy", folder / f"{k}.csv"):
            file.write_bytes(data)
            for key in ("terrain.height_map='{}'", "soil.map={{file='{}',spacing_m=0.5}}"):
                yield partial(command, "run", scenario, "--set", key.format(file), *out)
            for words in (("bench", "--compare", CARD), ("fit", "tube"), ("log", "replay")):
                yield partial(command, *words, file)
            yield partial(command, "bench", "pid", "--seeds-file", file, *out)


def kills(folder: Path) -> Iterator[Attack]:
    """A sweep of six runs, killed at each of 100 random moments and continued."""
    study = folder / "study.toml"
    study.write_text(f"scenario = 'pavement'\nseeds = [1, 2, 3, 4, 5, 6]\n[set.path]\n{STRAIGHT}")
    words = "sweep", study, "-q", "--workers", "0", "-o"

    def row_bits(place: Path) -> list[str]:
        made = sorted(rows(place / "results.jsonl"), key=lambda row: str(row["run"]))
        cost = "wall_s", "timing."
        return [json.dumps({k: row[k] for k in row if not k.startswith(cost)}) for row in made]

    def killed(place: Path, after_s: float) -> str | None:
        isolated(partial(command, *words, place, codes=(0,)), after_s)
        failure = command(*words, place, codes=(0,))
        return failure or (None if row_bits(place) == expected else "other rows")

    for place in (folder / "first", folder / "alone"):  # the first loads what all others need
        begun = time.monotonic()
        command(*words, place, codes=(0,))
    takes_s, expected = time.monotonic() - begun, row_bits(folder / "alone")
    for k, draw in enumerate(map(random.Random, range(100))):
        yield partial(killed, folder / str(k), draw.uniform(0.0, takes_s))


def trust(folder: Path) -> Iterator[Attack]:
    """Scenarios and studies that name code in this folder, without `--trust`: it does not run."""
    (folder / "evil.py").write_text("def make(*parts, **options): raise RuntimeError")
    sys.path.insert(0, str(folder))
    stage = "[[stages]]\nmake = 'evil:make'\nafter = "
    named = ("[controller]\nname = 'evil:make'", "[controller]\nestimator = 'evil:make'")

    def untouched(*words: object) -> str | None:
        return command(*words) or (f"{words}: imported" if "evil" in sys.modules else None)

    for k, text in enumerate((*named, f"{stage}'sense'", f"{stage}'control'")):
        scenario, study = folder / f"{k}.toml", folder / f"study{k}.toml"
        scenario.write_text(f"[path]\n{STRAIGHT}{text}")
        study.write_text(f"scenario = '{scenario}'\nseeds = 1\n")
        for words in (
            ("run", scenario),
            ("serve", scenario),
            ("search", "rays", scenario, "slope"),
        ):
            yield partial(untouched, *words, "-o", folder / "out")
        yield partial(untouched, "sweep", study, "--workers", "0", "-o", folder / "out")


def crowds(folder: Path) -> Iterator[Attack]:
    """Three runs into one folder at once: one is made, the others are refused."""
    scenario = folder / "short.toml"
    scenario.write_text(f"[path]\n{STRAIGHT}")

    def together(place: Path) -> str | None:
        one = partial(command, "run", scenario, "-q", "-o", place, codes=(0,))
        with ThreadPoolExecutor(3) as pool:
            said = sorted(pool.map(isolated, [one] * 3))
        made = said[0] == "" and all("exit code 2" in text for text in said[1:])
        return command("log", "check", place, codes=(0,)) if made else str(said)

    yield from (partial(together, folder / str(k)) for k in range(12))


def threads(_folder: Path) -> Iterator[Attack]:
    """Four simulations in threads have the same bits as alone."""

    def commands(controller: str) -> bytes:
        keys = "path={kind='straight', length_m=6.0}", f"controller.name='{controller}'"
        return simulate(*load("pavement", keys), 1)[1][CONTROL].values.tobytes()

    def beside(names: tuple[str, ...]) -> str | None:
        with ThreadPoolExecutor(len(names)) as pool:
            made = list(pool.map(commands, names))
        return None if made == list(map(commands, names)) else f"{names}: other bits"

    for names in permutations(("ttempc", "pid", "lqr", "ttempc-nominal")):
        yield partial(beside, names)


def main() -> int:
    """Attack and print a table; return 1 where anything failed."""
    lines, wrong = [], []
    for attacks in (kills, files, trust, crowds, threads):
        with tempfile.TemporaryDirectory() as place:
            failures = [isolated(attack) for attack in attacks(Path(place))]
        wrong += filter(None, failures)
        lines.append((attacks.__name__, str(len(failures)), str(sum(map(bool, failures)))))
    print(*wrong, sep="\n", file=sys.stderr)
    print(markdown(("class", "attacks", "failures"), lines))
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
