"""Space of a search: values, severity, distributions, and quantities by their names."""

import numpy as np
import pytest
from proving_ground.experiments.errors import ExperimentError
from proving_ground.experiments.scenario.scenario import parse_overrides, read_scenario
from proving_ground.experiments.search.quantities import DISTURBANCES, read_subject
from proving_ground.experiments.search.space import BOUND_SD, Parameter, Space
from proving_ground.experiments.sweep.envelope import QUANTITIES
from proving_ground.experiments.sweep.points import points_plan
from scipy.stats import kstest, norm

FORCE = Parameter(keys=("force",), low=0.0, high=10.0, nominal=0.0)
STRENGTH = Parameter(keys=("kpa",), low=100.0, high=1600.0, nominal=400.0, spacing="log")
PLACE = Parameter(keys=("at",), low=5.0, high=25.0, nominal=None)


def subject(*words, overrides=()):
    draft = read_scenario("grass")
    return read_subject(draft, "grass", parse_overrides(overrides), words)


def test_a_position_and_its_value_are_inverse():
    for parameter in (FORCE, STRENGTH, PLACE):
        for position in (0.0, 0.3, 1.0):
            assert parameter.position(parameter.value(position)) == pytest.approx(
                position, abs=1e-5
            )
    assert STRENGTH.value(0.5) == 400.0  # the geometric mean


def test_severity_is_0_at_the_nominal_values_and_1_at_the_farther_bounds():
    space = Space((FORCE, STRENGTH, PLACE))
    for place in (0.0, 0.9):
        nominal = np.array([*space.nominal[:2], place])
        assert space.severity(nominal) == 0.0
        assert space.severity(np.array([1.0, 1.0, place])) == pytest.approx(1.0)
    assert space.severity(np.array([1.0, 0.5, 0.0])) == pytest.approx(np.sqrt(0.5))


def test_steps_and_names_are_values_of_the_scenario():
    step = Parameter(keys=("a", "b"), low=0.0, high=1.0, nominal=0.0, step=0.01)
    name = Parameter(keys=("c",), low=0.0, high=2.0, nominal=1.0, names=("x", "y", "z"))
    assert Space((step, name)).changes(np.array([0.4567, 0.9])) == {"a": 0.46, "b": 0.46, "c": "z"}


def test_distributions_are_those_stated():
    """Free: uniform. One-sided: half-normal, truncated. Symmetric: normal, truncated."""
    symmetric = Parameter(keys=("s",), low=-1.0, high=1.0, nominal=0.0)
    normal = np.random.default_rng(1).standard_normal((4000, 3))
    points = Space((PLACE, FORCE, symmetric)).from_normal(normal)
    assert ((points >= 0.0) & (points <= 1.0)).all()
    assert kstest(points[:, 0], "uniform").pvalue > 0.01
    within = norm.cdf(BOUND_SD) - norm.cdf(-BOUND_SD)

    def half_normal(x):
        return (2.0 * norm.cdf(BOUND_SD * np.asarray(x)) - 1.0) / within

    assert kstest(points[:, 1], half_normal).pvalue > 0.01
    assert kstest(2.0 * np.abs(points[:, 2] - 0.5), half_normal).pvalue > 0.01


@pytest.mark.parametrize("word", [*DISTURBANCES, *QUANTITIES])
def test_every_name_makes_scenarios_over_its_whole_range(word):
    """Corners but for combinations that the scenario refuses for a stated reason: none here."""
    found = subject(word, overrides=["path.laps=1"])
    size = len(found.space.parameters)
    assert found.space.severity(found.space.nominal) == 0.0
    for corner in (np.zeros(size), np.ones(size)):
        changes = found.space.changes(corner)
        plan = points_plan(found.scenario, [changes], found.settings)
        assert plan.extent().runs == 1
        setting = plan.setting(changes)
        assert dict(setting.axes) == changes


def test_an_added_fault_stands_beside_those_of_the_scenario():
    own = "faults=[{kind='gnss_out', name='dark', start_s=3.0, duration_s=1.0}]"
    found = subject("gust", "faults.dark.duration_s=0.5:5", overrides=[own])
    plan = points_plan("grass", [found.space.changes(found.space.nominal)], found.settings)
    faults = plan[0].setting.scenario.faults
    assert [fault.label for fault in faults] == ["dark", "gust"]
    assert faults[0].duration_s == 1.0


def test_bounds_of_a_key_replace_those_of_a_name():
    space = subject("gust", "faults.gust.force_n=100:200").space
    (force,) = (p for p in space.parameters if p.keys == ("faults.gust.force_n",))
    assert (force.low, force.high, force.nominal) == (100.0, 200.0, 100.0)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("gusts",), r"must be KEY=LOW:HIGH or one of .*did you mean gust\?"),
        (("soil.cone_index_kpa=9:8",), "two numbers, LOW below HIGH"),
        (("soil.cone_index_kpa=a:8",), "two numbers, LOW below HIGH"),
        (("soil.cone_index_kpa=8:9:loose",), "KEY=LOW:HIGH:free"),
        (("soil.cone_index_kpa=100:200",), "must be a number from 100 to 200, the bounds, got 600"),
        (("terrain.iso_class=1:2",), "must be a number from 1 to 2"),
        (("terrain.uphill_deg=0:360:free",), "no quantity has a severity"),
        (("soil.no_such_key=0:1",), "got None"),
        (("faults.gust.force_n=0:1",), "names here: none"),
    ],
)
def test_what_cannot_be_searched_is_refused(words, message):
    with pytest.raises(ExperimentError, match=message):
        subject(*words)
