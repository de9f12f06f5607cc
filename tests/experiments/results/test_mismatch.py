"""Table of plant and model: actuators and sensors count, and what was learnt stands beside them."""

import matplotlib.pyplot as plt
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.pictures.figures.run_figures import error_figure
from proving_ground.experiments.results.mismatch import format_mismatch, mismatch_rows
from proving_ground.experiments.run.assembly import assemble
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load

STRAIGHT = "path={kind='straight', length_m=4.0}"


def mismatch_of(*overrides):
    assembly = assemble(load("grass", [STRAIGHT, *overrides])[1], 1)
    return {item.key: (item.plant, item.model) for item in assembly.mismatch}


@pytest.mark.parametrize(
    ("override", "key", "values"),
    [
        ("actuators.front.dead_time_s=0.3", "front_dead_time_s", (0.3, 0.0)),
        ("actuators.hydrostat.dead_time_s=0.2", "hydrostat_dead_time_s", (0.2, 0.0)),
        ("actuators.trailer.dead_band_deg=0.5", "actuators.trailer.dead_band_deg", (0.5, 0.0)),
        ("actuators.front.flow_right=0.7", "actuators.front.flow_right", (0.7, 1.0)),
        ("sensors.angle_resolution_deg=2.0", "sensors.angle_resolution_deg", (2.0, 0.0)),
        ("controller.vehicle.trailer_m=1.5", "trailer_m", (1.3, 1.5)),
        ("controller.noise.gnss_sd_m=0.01", "controller.noise.gnss_sd_m", (0.03, 0.01)),
    ],
)
def test_every_part_of_the_plant_that_the_model_has_otherwise_is_named(override, key, values):
    assert mismatch_of(override) == {key: values}


def test_a_dead_time_that_the_model_knows_is_no_mismatch():
    given = ("actuators.front.dead_time_s=0.3", "controller.vehicle.front_dead_time_s=0.3")
    assert mismatch_of() == mismatch_of(*given) == {}


def test_what_was_learnt_stands_beside_plant_and_model():
    rows = mismatch_rows(
        "front_dead_time_s 0 (true 0.3), load_kg 0 (true 300)",
        [
            "8 s: vehicle.dead_time_t 0 -> 0.324 +- 0.01 s, vehicle.trailer_length 1.3 -> 1.31 "
            "+- 0.02 m",
            "30 s: vehicle.dead_time_t 0.324 -> 0.301 +- 0.004 s",
        ],
    )
    assert [row.cells for row in rows] == [
        ("front_dead_time_s", "0.3", "0", "0.301 +- 0.004 at 30 s"),
        ("load_kg", "300", "0", ""),
        ("trailer_m", "1.3", "1.3", "1.31 +- 0.02 at 8 s"),
    ]
    assert len(format_mismatch(rows)) == 5
    assert format_mismatch(mismatch_rows("none", [])) == []


def test_console_page_and_figure_show_a_dead_time_and_that_it_was_learnt(tmp_path, capsys):
    """The plant's steering starts 0.3 s after the command, of which the model knows nothing."""
    overrides = ["--set", "actuators.front.dead_time_s=0.3", "--set", "path.laps=1"]
    out = tmp_path / "run"
    assert main(["run", "grass", *overrides, "--seed", "3", "--out", str(out)]) in (0, 3)
    printed = capsys.readouterr().out
    (line,) = [text for text in printed.splitlines() if "front_dead_time_s" in text]
    _, plant, model, learnt, *_ = line.split()
    assert (plant, model) == ("0.3", "0")
    assert float(learnt) == pytest.approx(0.3, abs=0.1)
    page = (out / "report.html").read_text()
    assert "<td>front_dead_time_s</td><td>0.3</td><td>0</td>" in page


def test_the_error_figure_marks_the_time_at_which_a_model_was_learnt():
    overrides = ["path={kind='straight', length_m=24.0}", "actuators.front.dead_time_s=0.3"]
    _, record = simulate(*load("grass", overrides), 3)
    learnt = [event.time_s for event in record.events if event.text.startswith("learnt: ")]
    assert learnt
    figure = error_figure(record)
    marks = {line.get_xdata()[0] for axes in figure.axes for line in axes.lines}
    assert set(learnt) <= marks
    plt.close(figure)
