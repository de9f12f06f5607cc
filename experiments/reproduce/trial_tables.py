"""Leaderboard of the field trials: entries that ship, driven here, and score cards of others."""

from __future__ import annotations

import sys
from typing import Final

from ...testbed.recording.provenance import code_digest
from ..trials.bench import Entrant, bench
from ..trials.draws import PUBLIC, public_draws
from ..trials.score_card import read_score_card
from ..trials.tables import leaderboard
from .driver import Driver
from .entry import Product
from .pages import ROOT

CARDS: Final = "field-trials"
"""Folder of the score cards, beside the page."""

SHIPPED: Final = (
    ("ttempc",),
    ("ttempc", "controller.options.tightening=none"),
    ("ttempc", "controller.learn=false"),
    ("ttempc-nominal",),
    ("ttempc-tube",),
    ("pid",),
    ("lqr",),
    ("nmpc",),
    ("nmpc-rti",),
    ("paper",),
)
"""Shipped controllers with changes as of `--set`."""

OTHERS: Final = (
    ("proving_ground.experiments.policy.linear_policy:learnt",),
    ("casadi_mpc:CasadiMpc",),
    ("do_mpc_controller:DoMpc",),
)
"""The learnt policy, and controllers of docs/examples written against the public interface."""

_FIELDS: Final = ("wet-slope", "old-valves", "cultivate", "rows", "grass-field")
PROBES: Final = (
    *((field, "ttempc") for field in _FIELDS),
    *(("grass", *words) for words in SHIPPED),
)
"""Probes of the table: the plant of the trials has its own."""


def field_trials(driver: Driver) -> Product:
    """Return the leaderboard, and the score cards of all entries driven here."""
    examples = str(ROOT / "docs" / "examples")
    if examples not in sys.path:  # the workers get this path, too
        sys.path.append(examples)
    draws = public_draws(driver.seeds(PUBLIC))
    entrants = [Entrant.of(name, changes) for name, *changes in (*SHIPPED, *OTHERS)]
    cards = {}
    for entrant in entrants:
        folder = driver.folder / code_digest() / f"bench-{draws.count}-{entrant.stem}"
        with driver.engine() as workers:
            cards[f"{CARDS}/{entrant.stem}.json"] = bench(entrant, draws, folder, workers)
    files = {name: card.to_json().encode() for name, card in cards.items()}
    shown, others = [*cards.values()], []
    for file in sorted((ROOT / "docs" / CARDS).glob("*.json")):
        if f"{CARDS}/{file.name}" not in cards:
            others.append(read_score_card(file))
    first = shown[0].identifier, shown[0].draws.sha256
    same = [card for card in others if (card.identifier, card.draws.sha256) == first]
    left_out = [f"`{card.label}` ({card.identifier})" for card in others if card not in same]
    count = f"{draws.count} seed{'s' if draws.count > 1 else ''}"
    parts = [f"Field trials `{first[0]}`, {count}.", leaderboard([*shown, *same])]
    if left_out:
        parts.append(f"Of other trials or seeds, not shown: {', '.join(left_out)}.")
    return Product("\n\n".join(parts), files)
