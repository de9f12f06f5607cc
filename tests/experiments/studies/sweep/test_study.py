"""Study files and plans: combinations, draws, pairing, refusals."""

import numpy as np
import pytest
from proving_ground.experiments.errors import ExperimentError, InvalidStudy
from proving_ground.experiments.studies.sweep.plan import SweepPlan
from proving_ground.experiments.studies.sweep.study import load_study, shipped_studies

from tests.experiments.study_files import CONTROLLERS, SHORT, STRENGTHS, plan_of


def listed(key, values):
    return f'[[axis]]\nkind = "list"\nkey = "{key}"\nvalues = {values}\n'


def drawn(kind, *keys, more=""):
    return "".join(
        f'[[axis]]\nkind = "{kind}"\nkey = "{key}"\nlow = 1.0\nhigh = 9.0\n{more}\n' for key in keys
    )


def test_every_combination_of_listed_values_is_a_run_under_every_seed(tmp_path):
    plan = plan_of(tmp_path, "seeds = [3, 8]", SHORT, STRENGTHS, CONTROLLERS)
    runs = [plan[run] for run in range(plan.size)]
    combinations = {(*run.setting.axes.values(), run.seed) for run in runs}
    expected = {
        (strength, driver, seed)
        for strength in (200.0, 500.0, 800.0)
        for driver in ("paper", "feedforward")
        for seed in (3, 8)
    }
    assert combinations == expected
    assert plan.size == len(expected)


VARIANTS = """
[[axis]]
kind = "variants"
name = "parts"
[axis.values."as it is"]
[axis.values."soft, slow"]
soil.cone_index_kpa = 300.0
path.speed_mps = 0.5
"""


def test_variants_are_named_sets_of_changes_whose_label_is_a_column(tmp_path):
    plan = plan_of(tmp_path, SHORT, VARIANTS, CONTROLLERS)
    assert plan.size == 4
    first, last = plan[0].setting, plan[3].setting
    assert [first.axes["parts"], last.axes["parts"]] == ["as it is", "soft, slow"]
    assert last.scenario.soil.cone_index_kpa == 300.0
    assert last.scenario.path.speed_mps == 0.5
    assert first.scenario.path.speed_mps != 0.5
    assert last.scenario.controller.name == "feedforward"
    again = tmp_path / "again.toml"
    again.write_text(plan.study.dump())
    assert load_study(str(again))[1] == plan.study


@pytest.mark.parametrize(
    ("axis", "text"),
    [
        (VARIANTS.replace("parts", "controller"), "controller"),
        (VARIANTS.replace("parts", "a.b"), "name"),
        (VARIANTS.replace("soil.", "sol."), "sol"),
        (VARIANTS + VARIANTS, "two axes move parts"),
    ],
)
def test_invalid_variants_are_refused(axis, text, tmp_path):
    with pytest.raises(InvalidStudy, match=text):
        plan_of(tmp_path, SHORT, axis).extent()


def test_a_latin_hypercube_has_one_point_in_every_slice_of_every_axis(tmp_path):
    keys = ("sensors.gnss_sd_m", "sensors.angle_sd_deg")
    plan = plan_of(tmp_path, "samples = 20", SHORT, drawn("latin-hypercube", *keys))
    points = np.array([[plan.changes(point)[key] for key in keys] for point in range(20)])
    slices = np.floor((points - 1.0) / 8.0 * 20).astype(int)
    assert (np.sort(slices, axis=0) == np.arange(20)[:, None]).all()


def test_random_axes_have_draws_of_their_own_and_stay_in_range(tmp_path):
    one = plan_of(tmp_path, "samples = 50", SHORT, drawn("random", "sensors.gnss_sd_m"))
    two = plan_of(
        tmp_path,
        "samples = 50",
        SHORT,
        drawn("random", "sensors.angle_sd_deg", "sensors.gnss_sd_m", more=""),
    )
    values = [one.changes(point)["sensors.gnss_sd_m"] for point in range(50)]
    assert values == [two.changes(point)["sensors.gnss_sd_m"] for point in range(50)]
    assert len({*values}) == 50
    assert all(1.0 <= value <= 9.0 for value in values)


def test_a_normal_axis_has_its_low_and_high_at_95_percent(tmp_path):
    normal = drawn("latin-hypercube", "sensors.gnss_sd_m", more='distribution = "normal"')
    plan = plan_of(tmp_path, "samples = 400", normal)
    values = np.array([plan.changes(point)["sensors.gnss_sd_m"] for point in range(400)])
    inside = np.mean((values >= 1.0) & (values <= 9.0))
    assert inside == pytest.approx(0.95, abs=2 / 400)


def test_a_relative_axis_multiplies_what_each_scenario_has(tmp_path):
    plan = plan_of(
        tmp_path,
        '[[axis]]\nkind="list"\nkey="scenario"\nvalues=["grass", "farm"]',
        '[[axis]]\nkind="list"\nkeys=["controller.vehicle.drawbar_m", "plant.vehicle.drawbar_m"]',
        "relative = true\nvalues = [[1.0, 1.0], [1.3, 1.0]]",
    )
    for first in (0, 2):
        plain, wrong = plan[first].setting.scenario, plan[first + 1].setting.scenario
        assert plain.controller.vehicle.drawbar_m is not None
        assert wrong.controller.vehicle.drawbar_m == pytest.approx(
            1.3 * plain.controller.vehicle.drawbar_m
        )
        assert wrong.plant == plain.plant


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("colour = 3", "colour: unknown key; allowed here: description, scenario, seeds"),
        ("seeds = 0", "seeds"),
        ('scenario = "gras"', "scenario 'gras': no such scenario"),
        ("samples = 3", "samples is given, but no axis is random"),
        ('[[axis]]\nkind="list"\nvalues=[1]', "give key, or keys"),
        ('[[axis]]\nkind="gird"\nkey="a"', "axis.0: Input tag 'gird'"),
        (listed("path.laps", "[]"), "axis.0.values"),
        (drawn("random", "path.speed_mps"), "samples is missing"),
        (2 * listed("path.laps", "[1]"), "two axes move path.laps"),
        (
            '[[axis]]\nkind="grid"\nkey="path.speed_mps"\nlow=0.0\nhigh=1.0\ncount=3\nspacing="log"',
            "low must be above 0",
        ),
        (listed("soil.softness", "[3]"), "soil.softness = 3:"),
        (listed("soil.cone_index_kpa", "[300.0, -3.0]"), "soil.cone_index_kpa = -3.0:"),
        (listed("soil", "[3]"), "soil = 3:"),
        (listed("sensors.gnss_latency_s", "[0.2, 0.0125]"), "sensors.gnss_latency_s = 0.0125"),
        (listed("controller", '["me"]'), "controller = 'me': controller 'me' does not exist"),
        (
            listed("plant.vehicle.load_kg", '["heavy"]') + "relative = true",
            "plant.vehicle.load_kg",
        ),
    ],
)
def test_invalid_studies_are_refused_in_one_line_before_any_run(text, message, tmp_path):
    with pytest.raises(ExperimentError) as refused:
        plan_of(tmp_path, text).extent()
    assert message in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1


def test_shipped_studies_have_a_description_and_valid_scenarios():
    for name in shipped_studies():
        study = load_study(name)[1]
        assert study.description
        assert SweepPlan(name, study)[0].setting.scenario


REFUSING = listed("soil.cone_index_kpa", "[300.0, -3.0, 600.0]")


def test_refused_combinations_are_left_out_where_the_study_says_so(tmp_path):
    plan = plan_of(tmp_path, "seeds = 2\nskip_refused = true", SHORT, REFUSING, CONTROLLERS)
    extent = plan.extent()
    assert [*plan.runs()] == [0, 1, 2, 3, 8, 9, 10, 11]
    assert extent.runs == plan.run_count == 8
    assert len(extent.refused) == 2
    assert all("soil.cone_index_kpa = -3.0" in reason for reason in extent.refused)
    without = plan_of(tmp_path, "seeds = 2", SHORT, REFUSING, CONTROLLERS)
    with pytest.raises(InvalidStudy, match=r"soil.cone_index_kpa = -3.0"):
        without.extent()


def test_of_drawn_points_the_ends_are_checked_and_the_values_of_all(tmp_path, monkeypatch):
    """Path and ground of the others are not looked at: a study of 10 000 points begins at once."""
    checked = []

    def check(scenario):
        checked.append(scenario.soil.cone_index_kpa)
        return 100

    monkeypatch.setattr("proving_ground.experiments.studies.sweep.plan.check", check)
    axis = drawn("latin-hypercube", "soil.cone_index_kpa").replace("1.0", "300.0")
    axis = axis.replace("9.0", "900.0")
    plan = plan_of(tmp_path, "samples = 50", SHORT, axis)
    values = [plan.changes(point)["soil.cone_index_kpa"] for point in range(50)]
    extent = plan.extent()
    assert {*checked} == {min(values), max(values)}
    assert extent.runs == 50
    assert extent.simulated_s == pytest.approx(50 * 100 * 0.2)
    other = plan_of(tmp_path, "samples = 50\ndraw = 2", SHORT, axis)
    assert other.extent().digest != extent.digest
    below = axis.replace("low = 300.0", "low = -300.0")
    with pytest.raises(InvalidStudy, match=r"soil.cone_index_kpa = -"):
        plan_of(tmp_path, "samples = 50", SHORT, below).extent()


def test_a_drawn_point_that_a_scenario_refuses_is_found_where_refused_ones_are_left_out(tmp_path):
    axis = drawn("latin-hypercube", "path.length_m").replace("9.0", "70.0")
    plan = plan_of(tmp_path, "samples = 6\nskip_refused = true", SHORT, axis)
    lengths = [plan.changes(point)["path.length_m"] for point in plan.runs()]
    assert 0 < len(lengths) < 6
    assert max(lengths) < 40.0  # from the middle of the field to its edge
