"""Fit of receivers: the parameters of drawn errors come back; a missing record is one line."""

import pytest
from proving_ground.experiments.papers import receivers
from proving_ground.testbed.sensing.receivers import receiver

from tests.testbed.receiver_drive import drive

SPEED = 3.0  # [m/s], to the north
PLACES = ("open-sky", "wood", "street")
EPOCHS = 2000  # of each place, 5 Hz


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Fit to a drive with errors of the model, one place after the other."""
    folder = tmp_path_factory.mktemp("records")
    for name in receivers.FILES:
        (folder / name).parent.mkdir(exist_ok=True)
    solution, truth, rest = ["% head"], ["head"], ["% head"]
    for n, place in enumerate(PLACES):
        for k, drawn in enumerate(drive(place, SPEED, EPOCHS, seed=4)):
            time, north = 1000.0 + 0.2 * (n * EPOCHS + k), 0.2 * SPEED * (n * EPOCHS + k)
            x, y = (value / 111e3 for value in (drawn[0], north + drawn[1]))
            solution.append(f"9 {time:.1f} {y:.10f} {x:.10f} 0 {drawn[4]:.0f} 9")
            truth.append(f"{time:.1f},9,{north / 111e3:.10f},0,0,0,0,0,0,0,0,0,{SPEED},0")
    for k, drawn in enumerate(drive("open-sky", 0.0, 300, seed=5, period=1.0)):
        x, y = drawn[:2] / 111e3
        rest.append(f"2024/06/24 08:{k // 60:02}:{k % 60:02}.000 {y:.10f} {x:.10f} 0 1 9")
    for name, lines in zip(receivers.FILES, (rest, solution, truth), strict=True):
        (folder / name).write_text("\n".join(lines))
    return receivers.fitted(folder)


@pytest.mark.parametrize("place", PLACES)
def test_deviations_and_rates_come_back(table, place):
    of, own = receiver(place), table[place]
    assert own["sd_m"] == pytest.approx(of.sd, rel=0.15)
    assert own["white_sd_m"] == pytest.approx(of.white_sd, rel=0.15)
    lost = of.lost_per_s + SPEED * of.lost_per_m
    assert own["lost_per_s"] + SPEED * own["lost_per_m"] == pytest.approx(lost, rel=0.2)
    if place != "open-sky":
        assert own["float_sd_m"] == pytest.approx(of.float_sd, rel=0.5)
        assert own["float_first_sd_m"] == pytest.approx(of.float_first_sd, rel=0.5)


def test_the_length_comes_back(table):
    of = receiver("wood")
    assert table["motion"]["correlation_length_m"] == pytest.approx(of.length, rel=0.25)


def test_a_missing_record_is_refused_in_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["receivers", str(tmp_path)])
    assert receivers.main() == 2
    line = capsys.readouterr().err
    assert line.count("\n") == 1
    assert "taroz/MatRTKLIB" in line
