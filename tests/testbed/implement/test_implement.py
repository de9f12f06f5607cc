"""Settings of an implement and its draft after ASABE D497."""

import pytest
from proving_ground.experiments.errors import InvalidScenario
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.implement.implement import Implement
from proving_ground.testbed.implement.mounted import check_pull
from proving_ground.testbed.wheels.soil_law import SoilLaw

from tests.testbed.plants import SMALL


def test_draft_of_a_published_example():
    """45 shanks, 15 cm, 10 km/h, factor 0.7: 68512.5 N (progressivegardening.com)."""
    plough = Implement(type="chisel-plough", width_m=13.5, depth_m=0.15, texture="fine")
    assert 0.7 * plough.draft(10.0 / 3.6) == pytest.approx(68512.5)


def test_draft_grows_with_the_square_of_the_speed_of_a_subsoiler():
    tool = Implement(type="subsoiler", width_m=3.0, depth_m=0.3, texture="fine")
    for kmh, newton in ((0.0, 27120.0), (6.0, 34896.0)):  # 4 tools x 30 cm x (226 + 1.8 S^2)
        assert tool.draft(kmh / 3.6) == pytest.approx(newton)


def test_the_default_implement_is_one_that_the_small_tractor_pulls():
    check_pull(SoilLaw(), Implement(), SMALL, 600.0, 1.0)
    with pytest.raises(InvalidPlant, match="at most 30 % slip, but cannot pull it"):
        check_pull(SoilLaw(), Implement(depth_m=0.8), SMALL, 600.0, 1.0)


def test_a_refusal_names_the_key_and_what_is_allowed():
    for override, message in (
        ('implement.type="spade"', "implement.type: .*chisel-plough"),
        ("implement.work_m=[[5.0, 2.0]]", "work_m"),
        ("implement.work_m=[[0.0, 9.0], [8.0, 12.0]]", "work_m"),
        ("implement.depth_m=0.0", "implement.depth_m"),
        ('implement={type="disk-harrow", spacing_m=0.2}', "spacing_m"),
        ("implement.deep_m=0.1", "implement.deep_m: .*type, width_m"),
    ):
        with pytest.raises((InvalidScenario, InvalidPlant), match=message) as refusal:
            load("grass", [override])
        assert "\n" not in str(refusal.value)
