"""Score cards of made-up runs."""

import numpy as np
from proving_ground.experiments.studies.trials import definition
from proving_ground.experiments.studies.trials.score_card import (
    CARD,
    PUBLIC,
    ScoreCard,
    TrialRun,
    public_draws,
    score,
)


def scored():
    """Return the trials that count in the score."""
    return [name for name in definition.trial_files() if definition.is_scored(name)]


def card_of(errors, name="one", **changes):
    """Return a card of made-up runs: errors (trials, seeds), NaN of a run that was lost."""
    trials = {
        trial: tuple(
            TrialRun(status="lost", failure="roll-over")
            if np.isnan(error)
            else TrialRun(status="completed", working_p95_m=float(error))
            for error in own
        )
        for trial, own in zip(scored(), errors, strict=False)
    }
    seeds = PUBLIC[: len(errors[0])]
    content = {
        "format": CARD,
        "identifier": definition.identifier(),
        "controller": name,
        "draws": public_draws(seeds),
        "machine": {"processor": "P", "system": "S"},
        "versions": {"ttempc": "0"},
        "score": score(trials),
        "trials": trials,
    }
    return ScoreCard(**{**content, **changes})
