"""Random driving never leaves MuJoCo with a warning, a reset or a NaN."""

import pytest
from proving_ground.experiments.studies.endurance import endure
from proving_ground.testbed.ground.terrain import ISO_8608

from tests.cards import bench_of


@pytest.mark.parametrize(
    "seconds", [20.0, pytest.param(1800.0, marks=pytest.mark.slow)], ids=["short", "3 h in all"]
)
@pytest.mark.parametrize("iso_class", ISO_8608)
def test_random_driving_stays_valid(iso_class, seconds):
    result = endure(bench_of("grass"), iso_class, seconds)
    assert not result.invalid
    assert result.driven_s == pytest.approx(seconds, abs=1.0)
    assert result.top_speed < 1.6


def test_a_diverged_simulation_is_counted(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its own log beside the user
    bench = bench_of("grass")
    whole = type(bench).plant

    def torn(self, *arguments, **options):
        plant = whole(self, *arguments, **options)
        reset = plant.reset

        def tear(*pose):
            truth = reset(*pose)
            plant.model.opt.gravity[2] = float("nan")
            return truth

        plant.reset = tear
        return plant

    monkeypatch.setattr(type(bench), "plant", torn)
    assert endure(bench, "A", 1.0).invalid
