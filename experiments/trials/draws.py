"""Seeds of a bench: the public ones, or those of an organiser by their published hash."""

from __future__ import annotations

import hashlib
import secrets
from pathlib import Path
from typing import Annotated, Final, Literal

from pydantic import Field
from pydantic.dataclasses import dataclass

from ...testbed.configuration.config_io import STRICT
from ..errors import BadOptions
from ..output import refuse_existing, write_file
from ..seeds import TRIALS
from ..sweep.study import Seed

PUBLIC: Final = tuple(TRIALS)
"""The public seeds."""

MOST: Final = 1000
"""Largest number of seeds of a file."""

_LARGEST: Final = 2**32 - 1


@dataclass(frozen=True, config=STRICT)
class Draws:
    """Seeds under which every trial is driven, each once."""

    kind: Literal["public", "quick", "hidden"]
    sha256: str
    """Of the seeds as text, one a line: that of an organiser's file."""
    count: Annotated[int, Field(ge=1, le=MOST)]
    seeds: tuple[Seed, ...] | None = None
    """The seeds; absent in the score card of hidden ones."""


def public_draws(seeds: tuple[int, ...] = PUBLIC) -> Draws:
    """Return public seeds; others than all of them make a quick bench."""
    kind = "public" if seeds == PUBLIC else "quick"
    return Draws(kind, seeds_hash(seeds), len(seeds), seeds)


def hidden_draws(file: Path) -> Draws:
    """Return the seeds of an organiser's file, whole numbers separated by white space.

    Raises:
        BadOptions: the file cannot be read, or its content is not allowed.
    """
    try:
        words = file.read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "is no text"
        raise BadOptions(f"--seeds-file {file}: cannot be read: {reason}") from None
    if not 1 <= len(words) <= MOST or len({*words}) < len(words):
        raise BadOptions(
            f"--seeds-file {file}: has {len(words)} seeds, must have 1 to {MOST}, each once"
        )
    for word in words:
        if not (word.isascii() and word.isdecimal() and str(int(word[:11])) == word):
            raise BadOptions(f"--seeds-file {file}: {word[:40]!r} is no whole number")
        if int(word) > _LARGEST:
            raise BadOptions(f"--seeds-file {file}: {word} must be from 0 to {_LARGEST}")
    seeds = tuple(int(word) for word in words)
    return Draws("hidden", seeds_hash(seeds), len(seeds), seeds)


def draw_hidden(file: Path) -> Draws:
    """Draw as many seeds as there are public ones and write them to a new file, one a line.

    The hash does not give the seeds away: they are drawn by the system, 32 bits each.

    Raises:
        OutputExists: the file exists already or cannot be written.
    """
    refuse_existing(file)
    seeds: dict[int, None] = {}
    while len(seeds) < len(PUBLIC):
        seeds[secrets.randbits(32)] = None
    write_file(file, _text((*seeds,)))
    return hidden_draws(file)


def seeds_hash(seeds: tuple[int, ...]) -> str:
    """Return the SHA-256 of seeds, as `sha256sum` prints it of a file with one seed a line."""
    return hashlib.sha256(_text(seeds).encode()).hexdigest()


def _text(seeds: tuple[int, ...]) -> str:
    return "".join(f"{seed}\n" for seed in seeds)
