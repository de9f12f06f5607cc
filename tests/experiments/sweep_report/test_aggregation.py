"""Rows of a sweep: reading, grouping, and the way from a number back to its runs."""

import json
import shlex
import shutil
import sys

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidRows
from proving_ground.experiments.scenario.scenario import dump, load
from proving_ground.experiments.sweep.failure import ERROR
from proving_ground.experiments.sweep.plan import SweepPlan
from proving_ground.experiments.sweep.row import no_figures
from proving_ground.experiments.sweep.study import load_study
from proving_ground.experiments.sweep_report.aggregate import (
    cells,
    controller_groups,
    controller_tail,
    difference_cells,
    paired_differences,
    ranking,
)
from proving_ground.experiments.sweep_report.axes import scales
from proving_ground.experiments.sweep_report.format import format_numbers, rerun_command
from proving_ground.experiments.sweep_report.runs import read_sweep

from tests.experiments.sweep_rows import AXES, DRAWN, swept, synthetic_row


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return swept(tmp_path_factory.mktemp("study"), "seeds = 5", AXES)


@pytest.fixture(scope="module")
def three_rows(tmp_path_factory):
    return swept(tmp_path_factory.mktemp("begun"), "seeds = 5", AXES, most=3)


@pytest.fixture
def begun(three_rows, tmp_path):
    """A folder of three rows, to spoil."""
    return shutil.copytree(three_rows, tmp_path / three_rows.name)


@pytest.fixture(scope="module")
def runs(folder):
    return read_sweep(folder)


def numbers(text):
    """Parse the text of `format_numbers`, as the page does."""
    result = []
    for part in filter(None, text.split(", ")):
        span, _, step = part.partition("/")
        first, _, last = span.partition("-")
        result += range(int(first), int(last or first) + 1, int(step or 1))
    return result


def test_every_run_is_in_one_cell_and_every_number_leads_to_its_runs(runs):
    grouped = cells(runs, scales(runs))
    assert len(grouped) == 3 * 4 * 3
    numbered = [run for cell in grouped for run in numbers(format_numbers(cell.group.runs))]
    assert sorted(numbered) == list(range(180))
    rows = {row["run"]: row for row in runs.rows}
    for cell in grouped:
        mine = [rows[run] for run in cell.group.runs]
        assert {row["controller"] for row in mine} == {runs.controllers[cell.group.controller]}
        assert {row["terrain.iso_class"] for row in mine} == {"ACE"[cell.places[0]]}
        assert len({row["soil.cone_index_kpa"] for row in mine}) == 1
        errors = [100 * row[ERROR] for row in mine if row["status"] == "completed"]
        assert len(cell.group.failed) == 5 - len(errors)
        assert (cell.group.error_cm is None) == (not errors)
        if errors:
            assert cell.group.error_cm.value == pytest.approx(np.mean(errors))


@pytest.mark.parametrize("chance", [0.02, 0.3, 0.9, 1.0])
def test_number_ranges_can_be_parsed(chance):
    chosen = np.flatnonzero(np.random.default_rng(1).random(500) < chance)
    assert numbers(format_numbers(chosen)) == chosen.tolist()
    assert format_numbers(np.arange(3, 2000, 3)) == "3-1998/3"
    assert format_numbers([4]) == "4"
    assert format_numbers([]) == ""


def test_differences_are_those_of_the_same_ground(runs):
    ttempc, feedforward = paired_differences(runs, 0)
    rows = {(row["controller"], row["point"], row["seed"]): row[ERROR] for row in runs.rows}
    pairs = [
        (error, rows["paper", *key]) for (name, *key), error in rows.items() if name == "ttempc"
    ]
    expected = 100 * np.mean([one - other for one, other in pairs])
    assert ttempc.error_cm.value == pytest.approx(expected)
    assert (ttempc.pairs, len(ttempc.alone_failed), len(ttempc.other_failed)) == (60, 0, 0)
    assert (feedforward.pairs, len(feedforward.alone_failed)) == (40, 20)
    # The ground is common: the difference is far surer than the two errors.
    wide = controller_groups(runs)[0].error_cm
    assert ttempc.error_cm.high - ttempc.error_cm.low < wide.high - wide.low
    back = paired_differences(runs, 1)[0]
    assert back.error_cm.value == pytest.approx(-ttempc.error_cm.value)


def test_a_limit_makes_runs_fail_that_completed(folder, runs):
    strict = read_sweep(folder, 0.1)
    assert runs.failed.sum() == 20
    assert (strict.failed == (runs.failed | (runs.error_cm > 10.0))).all()
    assert controller_groups(strict)[0].fails
    assert controller_tail(strict, 0) == controller_tail(runs, 0)


def test_axes_have_words_units_and_the_order_of_the_study(runs):
    roughness, strength = scales(runs)
    assert (roughness.label, roughness.texts) == ("ISO class", ("A", "C", "E"))
    assert strength.label == "cone index [kPa]"
    assert strength.logarithmic
    assert strength.texts == ("150", "356", "843", "2000")


def test_drawn_axes_are_binned_evenly_and_points_are_drawn_anew(tmp_path):
    runs = read_sweep(swept(tmp_path, "seeds = 2", DRAWN))
    (scale,) = scales(runs)
    assert scale.binned
    assert sorted(np.bincount(scale.place)) == [6, 6, 6, 6, 8, 8]
    assert len(set(runs.unit)) == 20


def test_a_sweep_in_progress_can_be_reported(tmp_path):
    folder = swept(tmp_path, "seeds = 5", AXES, most=40)
    file = folder / "results.jsonl"
    file.write_bytes(file.read_bytes() + b'{"run":41,"po')
    runs = read_sweep(folder)
    assert (len(runs.rows), runs.missing) == (40, 140)
    assert runs.controllers == ("paper", "ttempc", "feedforward")


@pytest.mark.parametrize("study", ["terrain-slip", "mismatch", "delay", "compare"])
def test_the_command_of_a_row_drives_the_same_scenario(study):
    plan = SweepPlan(*load_study(study))
    for run in (0, plan.size // 2, plan.size - 1):
        planned = plan[run]
        setting = planned.setting
        row = {
            "scenario": setting.name,
            "controller": setting.scenario.controller.name,
            "seed": planned.seed,
            **setting.axes,
        }
        _, _, name, *options = shlex.split(rerun_command(plan.study, row))
        given = {"seed": "", "controller": ""}
        overrides = []
        for option, value in zip(options[::2], options[1::2], strict=True):
            if option == "--set":
                overrides.append(value)
            else:
                given[option[2:]] = value
        overrides.append(f'controller.name="{given["controller"]}"')
        assert given["seed"] == str(planned.seed)
        assert dump(load(name, overrides)[1]) == setting.toml


def _changed(folder, change):
    lines = (folder / "results.jsonl").read_text().splitlines(keepends=True)
    (folder / "results.jsonl").write_text("".join(change(lines)))


def _without(lines):
    row = json.loads(lines[1])
    del row["tracking.all.trailer.cross_p95_m"]
    return [lines[0], json.dumps(row) + "\n"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda lines: [], "holds no row yet"),
        (lambda lines: [lines[0][:50]], "holds no row yet"),
        (lambda lines: [lines[0], "no json\n", lines[1]], "line 2 is no row"),
        (lambda lines: [lines[0], "[1]\n"], "line 2 .* is no object"),
        (lambda lines: [lines[0], lines[0]], "line 2 .* run 0 is there twice"),
        (lambda lines: [lines[0].replace('"run":0', '"run":999')], "run 999 of 180"),
        (lambda lines: [lines[0].replace('"seed":1', '"seed":"1"')], "seed is no whole number"),
        (_without, "line 2 .* column tracking.all.trailer.cross_p95_m is missing"),
    ],
)
def test_foreign_rows_are_refused_in_one_line(change, message, begun, capsys):
    _changed(begun, change)
    with pytest.raises(InvalidRows, match=message):
        read_sweep(begun)
    before = sorted(begun.iterdir())
    assert main(["report", str(begun)]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert sorted(begun.iterdir()) == before


@pytest.mark.parametrize("missing", ["", "study.toml", "versions.json", "results.jsonl"])
def test_a_folder_without_a_sweep_is_refused(missing, begun, capsys):
    if missing:
        (begun / missing).unlink()
    else:
        shutil.rmtree(begun)
    assert main(["report", str(begun)]) == 2
    assert "is no folder of a sweep" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [("--against", "pid", "the study has paper"), ("--limit", "0", "must be a length above 0")],
)
def test_invalid_options_are_refused(option, value, message, begun, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):  # as the program itself leaves
        sys.exit(main(["report", str(begun), option, value]))
    printed = capsys.readouterr().err
    assert message in printed
    assert printed.count("\n") == 1
    assert not (begun / "report").exists()


def test_runs_of_refused_combinations_are_not_missing(tmp_path, capsys):
    refusing = AXES.replace("values = [", 'values = ["Z", ')  # no such class
    parts = ("seeds = 1\nskip_refused = true", refusing.replace('["Z", "paper"', '["paper"'))
    folder = swept(tmp_path, *parts)
    runs = read_sweep(folder)
    assert (runs.planned, runs.missing, runs.refused, len(runs.rows)) == (36, 0, 12, 36)
    assert main(["report", str(folder)]) == 0
    assert "12 refused" in (folder / "report" / "summary.md").read_text()
    assert "12 refused" in (folder / "report" / "report.html").read_text()


def test_the_best_have_the_least_median_and_gain_nothing_by_runs_that_fail(runs, tmp_path):
    assert [runs.controllers[number] for number in ranking(runs)] == [
        "ttempc",
        "paper",
        "feedforward",
    ]

    def best_or_lost(job):
        row = synthetic_row(job)
        if job.scenario.controller.name != "feedforward" or row["status"] == "lost":
            return row
        if job.scenario.terrain.iso_class == "C":
            return job.row("lost", "rolled", no_figures(), 0.1)
        return {**row, ERROR: 1e-6}  # in the third of its runs that it completes

    spoilt = read_sweep(swept(tmp_path, "seeds = 2", AXES, work=best_or_lost))
    assert spoilt.controllers[ranking(spoilt)[-1]] == "feedforward"


def test_differences_of_cells_average_to_that_of_all_pairs(runs):
    """Every cell has as many pairs, so that the mean of their means is that of all."""
    axes = [scale for scale in scales(runs) if not scale.binned]
    ttempc, paper = map(runs.controllers.index, ("ttempc", "paper"))
    (whole,) = (item for item in paired_differences(runs, paper) if item.controller == ttempc)
    parts = difference_cells(runs, axes, ttempc, paper)
    assert len(parts) == 12
    average = np.mean([part.error_cm.value for part in parts])
    assert average == pytest.approx(whole.error_cm.value)
    back = difference_cells(runs, axes, paper, ttempc)
    assert [part.error_cm.value for part in back] == pytest.approx(
        [-part.error_cm.value for part in parts]
    )
