"""Leads over the default controller: pairs, margin, lost runs."""

import math

import pytest
from proving_ground.experiments.results.leads import MARGIN_CM, RunError, leads, leads_sentence


def runs(place, controller, errors):
    return [RunError(place, seed, controller, error) for seed, error in enumerate(errors)]


def test_a_lead_is_a_mean_over_pairs_beyond_the_margin():
    own = runs("a", "own", [2.0, 3.0])
    near = runs("a", "near", [2.0 - MARGIN_CM, 3.0 - 0.9 * MARGIN_CM])
    far = runs("a", "far", [2.4, 2.4])
    (lead,) = leads([*own, *near, *far], "own")
    assert (lead.place, lead.controller, lead.runs) == ("a", "far", 0)
    assert lead.error_cm == pytest.approx(0.1)


def test_a_pair_with_a_lost_run_counts_as_a_lost_run_alone():
    own = runs("a", "own", [2.0, math.nan, math.nan])
    other = runs("a", "other", [2.0, 1.0, math.nan])
    (lead,) = leads([*own, *other], "own")
    assert (lead.error_cm, lead.runs) == (0.0, 1)
    assert leads([*own, *other], "other") == []


def test_runs_that_the_default_one_did_not_drive_are_no_lead():
    assert leads([*runs("a", "own", [2.0]), *runs("b", "other", [1.0])], "own") == []


def test_the_sentence_names_every_lead_and_counts_the_other_places():
    ahead = [*runs("a", "own", [2.0]), *runs("a", "other", [1.0])]
    level = [*runs("b", "own", [2.0]), *runs("b", "other", [2.0])]
    assert leads_sentence([*ahead, *level], "own", "fields").startswith(
        "Ahead of `own`: `other` on `a` (1.00 cm). On 1 of 2 fields none of `other` is ahead"
    )
    assert leads_sentence(level, "own", "fields").startswith("On 1 of 1 fields none of `other`")
