import dataclasses
import json

import pytest
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.sweep.row import FIGURES, columns, figures, line, no_figures

SHORT = ["path={kind='straight', length_m=3.0}"]


@pytest.fixture(scope="module")
def summary():
    return simulate(*load("pavement", SHORT), seed=1)[0]


def test_every_number_of_a_summary_is_a_column(summary):
    def leaves(content, prefix=""):
        for key, value in content.items():
            if isinstance(value, dict):
                yield from leaves(value, f"{prefix}{key}.")
            elif isinstance(value, int | float):
                yield f"{prefix}{key}", value

    leaf_values = dict(leaves(dataclasses.asdict(summary)))
    del leaf_values["seed"]
    assert leaf_values
    assert figures(summary).items() >= leaf_values.items()


def test_a_run_without_figures_has_the_same_columns(summary):
    assert list(figures(summary)) == list(no_figures()) == list(FIGURES)
    assert set(no_figures().values()) == {None}


def test_columns_are_unique_and_hold_the_axes_once():
    names = columns(["scenario", "soil.cone_index_kpa", "controller"])
    assert len(names) == len(set(names))
    assert names.index("soil.cone_index_kpa") < names.index("status")


def test_a_line_is_json_of_one_line_and_refuses_what_json_does_not_know():
    assert json.loads(line({"failure": "two\nlines", "x": None})) == {
        "failure": "two\nlines",
        "x": None,
    }
    assert line({"failure": "two\nlines"}).count("\n") == 1
    with pytest.raises(ValueError, match="not JSON compliant"):
        line({"x": float("nan")})
