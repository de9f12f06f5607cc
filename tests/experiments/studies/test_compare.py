"""The study `compare`: its jobs, its file, its statistics."""

from __future__ import annotations

import numpy as np
import pytest

from proving_ground.experiments.errors import InvalidRows
from proving_ground.experiments.studies import compare
from proving_ground.experiments.studies.batch import Job
from proving_ground.experiments.studies.comparison import Comparison, bootstrap, markdown, picture


def row(scenario, seed, controller, error_m, status="completed"):
    return {
        "scenario": scenario,
        "seed": seed,
        "controller": controller,
        "status": status,
        "tracking.all.tractor.mean_euclidean_m": error_m,
        "tracking.all.trailer.mean_euclidean_m": error_m,
        "timing.control_step_us.median": 100.0 if controller == "a" else 1000.0,
    }


def rows(lost=False):
    """`b` errs by 1 cm more than `a` on every ground, which differ by far more."""
    made = []
    for scenario, base in (("x", 0.02), ("y", 0.10)):
        for seed in range(6):
            error = base * (1.0 + 0.2 * seed)
            made.append(row(scenario, seed, "a", error))
            gone = lost and (scenario, seed) == ("y", 3)
            made.append(row(scenario, seed, "b", error + 0.01, "lost" if gone else "completed"))
    return made


def test_interval_covers_the_mean_as_often_as_it_says():
    generator = np.random.default_rng(1)
    means = [bootstrap(generator.normal(3.0, 1.0, size=20)) for _ in range(200)]
    covered = np.mean([mean.low <= 3.0 <= mean.high for mean in means])
    assert 0.88 <= covered <= 0.99  # the percentile interval of 20 samples is a little narrow


def test_differences_are_paired_by_seed():
    comparison = Comparison.of(rows(), "a")
    difference = comparison.difference([0, 1], 1)
    assert difference is not None
    np.testing.assert_allclose([difference.value, difference.low, difference.high], 1.0)
    alone = comparison.error(1, 1)
    assert alone is not None
    assert alone.high - alone.low > 1.0


def test_a_lost_run_takes_its_field_out_of_the_mean_over_fields():
    comparison = Comparison.of(rows(lost=True), "a")
    assert comparison.survived(0) == [0, 1]
    assert comparison.survived(1) == [0]
    assert comparison.lost(1) == 1
    assert "| `b` | 1000 | 10.00 | 4.00 (+1.00 to +1.00) | 1 | 1 |" in markdown(comparison)


def test_picture_is_small():
    content = picture(Comparison.of(rows(), "a"))
    assert content.startswith(b"\x89PNG")
    assert len(content) < 300_000


@pytest.mark.parametrize(("made", "said"), [([], "no run of 'a'"), (rows()[:1] * 2, "two runs of")])
def test_rows_that_cannot_be_compared_are_refused(made, said):
    with pytest.raises(InvalidRows, match=said):
        Comparison.of(made, "a")


def test_goes_on_where_it_was_broken_off(tmp_path):
    file = tmp_path / "rows.jsonl"
    short = ('controller.name="pid"', 'path.kind="straight"', "path.length_m=9.0")
    jobs = [Job("pavement", seed, short) for seed in (1, 2)]
    compare.drive(file, jobs[:1], processes=0)
    first = file.read_text()
    compare.drive(file, jobs, processes=0)
    compare.drive(file, jobs, processes=0)
    assert file.read_text().startswith(first)
    assert [row["seed"] for row in compare.read(file)] == [1, 2]
    file.write_text(first + '{"scenario": "pav')
    with pytest.raises(InvalidRows, match="line 2"):
        compare.read(file)


def test_laps_are_those_of_the_figure_eight_alone():
    eight, line = compare.jobs(["pid"], ["grass", "split"], [4], 1)
    assert "path.laps=1" in eight.overrides
    assert line.overrides == ('controller.name="pid"',)


@pytest.mark.parametrize("option", [["--controllers", "pidd"], ["--scenarios", "gras"]])
def test_unknown_names_are_refused_before_any_work(option, tmp_path, capsys):
    file = tmp_path / "rows.jsonl"
    assert compare.main(["drive", str(file), *option]) == 2
    assert not file.exists()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert repr(option[1]) in said
