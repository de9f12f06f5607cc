"""Fit of tubes, their calibration on whole runs, and the tubes that ship."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from itertools import product

import numpy as np
import pytest
from proving_ground.experiments.commands.cli import main
from proving_ground.experiments.errors import InvalidFit
from proving_ground.experiments.pictures.report.run_page import write_page
from proving_ground.experiments.results.summary import RunFacts, summarise
from proving_ground.experiments.results.tracking_errors import QUANTITIES, Containment, containment
from proving_ground.experiments.run.assembly import check
from proving_ground.experiments.run.run_folder import run
from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.plant import PAPER_PERIOD_S
from proving_ground.experiments.scenario.scenario import load
from proving_ground.experiments.scenario.tube_file import read_tube, shipped_tubes, to_json
from proving_ground.experiments.studies.tubes.calibration import (
    DrivenRun,
    calibrate_tube,
    format_calibration,
)
from proving_ground.experiments.studies.tubes.fit import (
    fit_run,
    fit_tube,
    format_fit,
    hold_out,
    read_runs,
)
from proving_ground.testbed.recording.channels import (
    CHANNELS,
    CONTROL,
    ESTIMATE,
    REFERENCE,
    STATE,
    TUBE,
)
from proving_ground.testbed.recording.record import Record

from tests.records import table_of
from tests.ttempc.tubes import SPREAD
from ttempc.errors import InvalidTube
from ttempc.models.kinematics import trailer_point
from ttempc.mpc.articulated_error import error_dynamics, rotation
from ttempc.reference.reference import ConstantSpeed, Reference, exact_feedforward
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.tube.sets import fit_set
from ttempc.types import Disturbance, MapDisturbance, State
from ttempc.vehicle import Vehicle

NAME, SCENARIO = load("grass", ["path.laps=1"])
REFERENCE_PATH = Reference(SCENARIO.mission().path, Vehicle(), ConstantSpeed(1.0))
TICKS = 684  # one lap
FIELDS = ("x_t_m", "y_t_m", "psi_t_rad", "psi_i_rad", "delta_t_rad", "delta_i_rad", "v_mps")
INPUTS = ("delta_t_rad", "delta_i_rad", "hp")
ALONG_GRASS = ReferenceTube.along(read_tube("grass").design(), REFERENCE_PATH, TICKS)
DYNAMICS = error_dynamics(REFERENCE_PATH, PAPER_PERIOD_S, TICKS)


def made_up(seed, spread=SPREAD, blur=0.3):
    """Return a run with known residuals of the estimated error, and these residuals and errors."""
    generator = np.random.default_rng(seed)
    a, b, _ = DYNAMICS
    w = spread * generator.standard_normal((TICKS, 7))
    lasting = 0.01 * generator.standard_normal((TICKS, len(Disturbance)))
    time_s = PAPER_PERIOD_S * np.arange(TICKS)
    sample = REFERENCE_PATH.at(time_s)
    feedforward = exact_feedforward(REFERENCE_PATH, TICKS, PAPER_PERIOD_S)
    turn = rotation(sample.state[:, State.PSI_T])
    estimated, command = np.zeros((TICKS, 7)), np.zeros((TICKS, 3))
    for k in range(TICKS):
        u_e = 0.01 * generator.standard_normal(3)
        command[k] = feedforward[k] - u_e
        if k + 1 < TICKS:
            state = np.concatenate([estimated[k], lasting[k], np.zeros(len(MapDisturbance))])
            estimated[k + 1] = a[k, :7] @ state + b[k, :7] @ u_e + w[k]
    true = estimated + blur * spread * generator.standard_normal((TICKS, 7))

    def columns(error):
        error = error.copy()
        error[:, :2] = np.einsum("kij,kj->ki", turn, error[:, :2])
        state = sample.state - error
        points = np.array([trailer_point(one, Vehicle()) for one in state])
        return dict(zip(FIELDS, state.T, strict=True)) | {
            "x_i_m": points[:, 0],
            "y_i_m": points[:, 1],
        }

    estimate = columns(estimated)
    names = ("slip_t_rad", "slip_i_rad", "steering_rad", "drive_mps2", "wheel_slip")
    estimate |= dict(zip(names, lasting.T, strict=True))
    estimate |= dict.fromkeys(("side_x_rad", "side_y_rad", "climb_x", "climb_y"), np.zeros(TICKS))
    given = {
        STATE: columns(true),
        ESTIMATE: estimate,
        CONTROL: {f"{n}_command": command[:, i] for i, n in enumerate(INPUTS)},
        REFERENCE: columns(np.zeros((TICKS, 7))) | {"curvature_per_m": sample.curvature},
    }
    tables = {c.topic: table_of(c, time_s, given.get(c, {})) for c in CHANNELS}
    metadata = {"scenario": NAME, "controller": "made-up", "seed": str(seed)}
    return Record(tables, (), metadata), w, true, estimated


RUNS = [made_up(seed) for seed in range(6)]


def fitted(count=6):
    return [fit_run(record, SCENARIO) for record, *_ in RUNS[:count]]


def test_known_residuals_are_recovered():
    record, w, true, estimated = RUNS[0]
    fit_data = fit_run(record, SCENARIO)
    first = int(fit_data.errors.tick[0])
    assert first * PAPER_PERIOD_S >= 8.0
    np.testing.assert_allclose(fit_data.residuals, w[first:-1], atol=1e-9)
    np.testing.assert_allclose(fit_data.errors.estimation, (true - estimated)[first:], atol=1e-9)


def test_a_fitted_set_has_its_coverage_on_held_out_data():
    generator = np.random.default_rng(2)
    mix = generator.standard_normal((7, 7))
    draw = [(mix @ generator.standard_t(6, (7, 4000))).T for _ in range(4)]
    for shape, window in product(("box", "zonotope"), (1, 5)):
        fitted_set = fit_set(draw[:2], 0.95, window, shape)
        fresh = np.concatenate([fitted_set.fill(run) for run in draw[2:]])
        assert (fresh <= 1.0).mean() == pytest.approx(0.95, abs=0.015)
        count = hold_out(fitted_set, draw[2:])
        assert count.low <= 0.95 <= count.high


def test_a_tube_is_fitted_written_and_read_back(monkeypatch, tmp_path):
    monkeypatch.setattr("ttempc.tube.reference_tube._EVALUATIONS", 40)
    fit = fit_tube(fitted())
    provenance = fit.file.provenance
    assert provenance.fitted_seeds == [0, 1, 3, 4]
    assert provenance.held_out_seeds == [2, 5]
    assert provenance.disturbance.inside / provenance.disturbance.windows > 0.8
    assert np.all(fit.along.free_share > 0.0)
    text = format_fit(fit)
    assert "4 fitted, 2 held out" in text
    assert f"{100.0 * provenance.confidence:g} %" in text
    half_width = fit.along.half_widths[:, QUANTITIES.index("y_i_e_m")].max()
    (trailer,) = [row for row in text.splitlines() if "trailer cross-track [m]" in row]
    assert float(trailer.split()[-1]) == pytest.approx(half_width, abs=5e-4)
    file = tmp_path / "tube.json"
    file.write_text(to_json(fit.file))
    again = read_tube(str(file))
    assert again == fit.file
    tube = ReferenceTube.along(again.design(), REFERENCE_PATH, 200).tube
    np.testing.assert_allclose(tube.outputs, fit.along.tube.outputs[:200], rtol=0.02)


def test_too_little_or_too_much_is_refused_with_the_numbers():
    with pytest.raises(InvalidFit, match="got 2 runs, at least 3 are needed"):
        fit_tube(fitted(2), coverage=0.99)
    with pytest.raises(
        InvalidFit, match=r"got 1\d\d windows of 10 steps in 2 runs, .* 0\.99 .* takes 299"
    ):
        fit_tube(fitted(3), coverage=0.99)
    with pytest.raises(InvalidFit, match=r"coverage: got 1\.0, must be between 0 and 1"):
        fit_tube(fitted(), coverage=1.0)


def test_a_tube_file_that_makes_no_sense_is_refused_in_a_line(tmp_path):
    file = tmp_path / "bad.json"
    for change, message in (
        (lambda c: c.pop("vehicle"), "vehicle"),
        (lambda c: c["vehicle"].pop("wheelbase"), "wheelbase"),
        (lambda c: c["vehicle"].update(wheelbase=-1.0), "wheelbase: got -1.0"),
        (lambda c: c["disturbance"].update(shape="ball"), "disturbance.shape"),
        (lambda c: c["disturbance"]["axes"].pop(), "disturbance.axes"),
        (lambda c: c["disturbance"].update(axes=[[0.0] * 7] * 7), "of full rank"),
        (lambda c: c["weights"].update(inputs=[1.0, 0.0, 1.0]), "weights"),
        (lambda c: c["weights"].update(masses=[1.0]), "weights.masses: unknown key"),
        (lambda c: c.update(format=2), "format"),
    ):
        content = json.loads(to_json(read_tube("grass")))
        change(content)
        file.write_text(json.dumps(content))
        with pytest.raises(InvalidFit, match=message) as caught:
            read_tube(str(file))
        assert str(file) in str(caught.value)
        assert "\n" not in str(caught.value)


def test_a_tube_that_is_missing_or_of_another_vehicle_is_refused_before_driving():
    for tube in ("nowhere", "gone.json"):
        needs = ['controller.name="ttempc-tube"', f'controller.tube="{tube}"']
        with pytest.raises(InvalidFit, match=tube):
            simulate(*load("grass", needs), 1)
    for needs in ('controller.name="ttempc-tube"', 'controller.tube="grass"'):
        with pytest.raises(InvalidTube, match="another vehicle"):
            check(load("farm", [needs])[1])


def test_containment_is_counted_on_the_truth():
    record, _, true, _ = RUNS[0]

    nominal = {f"{name}_nominal": np.zeros(TICKS) for name in QUANTITIES}
    width = {f"{name}_half_width": np.full(TICKS, 100.0) for name in QUANTITIES}
    width["y_t_e_m_half_width"] = np.abs(true[:, 1]) * np.where(np.arange(TICKS) % 4, 2.0, 0.5)
    table = table_of(TUBE, record[STATE].time_s, nominal | width)
    record = replace(record, tables=dict(record.tables) | {TUBE.topic: table})
    contained = containment(record)
    np.testing.assert_allclose(contained.deviation[:, :7], true[40:], atol=1e-9)
    assert contained.curved.any()
    facts = RunFacts("", NAME, "made-up", 0, "completed", None, {}, None)
    statistics = summarise(record, facts).tube
    assert statistics is not None
    assert statistics.contained_fraction == pytest.approx(0.75, abs=0.01)
    assert statistics.margin_min == pytest.approx(-1.0)
    largest = statistics.half_width_max_m
    assert largest.tractor == width["y_t_e_m_half_width"][40:].max()
    assert largest.trailer == 100.0


def test_a_run_stays_in_its_tube_and_one_run_is_too_few_for_a_fit(tmp_path, capsys):
    overrides = ['path={kind="straight", length_m=12.0}', 'controller.name="ttempc-tube"']
    name, scenario = load("grass", overrides)
    finished = run(name, scenario, 5, tmp_path / "run")
    assert asdict(finished.summary)["tube"]["contained_fraction"] == 1.0
    assert len(finished.record[TUBE]) == len(finished.record[CONTROL])
    assert write_page(finished).files["tube"].exists()
    assert len(read_runs([tmp_path], fit_run)) == 1
    out = tmp_path / "tube.json"
    fit, laps = ["fit", "tube"], ["fit", "tube", "--laps-coverage", "0.95", str(tmp_path)]
    for line, words in (
        ([*fit, str(tmp_path), "-o", str(out)], "got 1 runs, at least 3"),
        ([*laps, "-o", str(out)], "got 1 runs, a coverage of 0.95 for the next run takes 23"),
        ([*laps, "--coverage", "0.9"], "--coverage"),
        ([*fit, str(tmp_path / "nothing")], "no log.mcap"),
    ):
        assert main(line) == 2
        assert words in capsys.readouterr().err
        assert not out.exists()
    out.write_text("")
    assert main([*fit, str(tmp_path), "-o", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err


def test_runs_of_a_fit_must_be_alike_complete_and_of_different_seeds():
    runs = fitted(4)
    softer = replace(SCENARIO, soil=replace(SCENARIO.soil, cone_index_kpa=300.0))
    with pytest.raises(InvalidFit, match=r"seed 1: soil.cone_index_kpa = 300.0, but 600.0 in .*0:"):
        fit_tube([runs[0], replace(runs[1], settings=softer), *runs[2:]])
    other = replace(SCENARIO, controller=replace(SCENARIO.controller, name="pid"))
    with pytest.raises(InvalidFit, match=r"seed 2: controller.name = 'pid', but 'ttempc' in"):
        fit_tube([*runs[:2], replace(runs[2], settings=other)])
    with pytest.raises(InvalidFit, match="grass, seed 1: there twice"):
        fit_tube([*runs[:2], runs[1]])
    record = RUNS[0][0]
    short = {
        t: replace(x, time_s=x.time_s[:500], values=x.values[:500])
        for t, x in record.tables.items()
    }
    with pytest.raises(InvalidFit, match=r"ended after 99.8 s of 136.7 s: runs must complete"):
        fit_run(replace(record, tables=short), SCENARIO)
    backwards = replace(record[CONTROL], time_s=record[CONTROL].time_s[::-1])
    with pytest.raises(InvalidFit, match="/control: its times"):
        fit_run(replace(record, tables={**record.tables, CONTROL.topic: backwards}), SCENARIO)


def test_a_fit_that_its_hold_out_contradicts_says_so(monkeypatch):
    monkeypatch.setattr("ttempc.tube.reference_tube._EVALUATIONS", 40)
    wilder = fit_run(made_up(9, spread=2.0 * SPREAD)[0], SCENARIO)
    fit = fit_tube([*fitted(2), wilder])
    first, *_ = fit.warnings
    assert first.startswith(f"{fit.file.provenance.disturbance.inside} of 64 held-out windows")
    assert "driven by made-up, which does not drive in a tube" in fit.warnings[-1]
    sound = fit_tube(fitted())
    assert len(sound.warnings) == 1  # that of the controller


def driven(seed, largest=(0.03, 0.05, 0.03, 0.04)):
    generator = np.random.default_rng(seed)
    settings = load("grass", ["path.laps=1", 'controller.name="ttempc-tube"'])[1]
    return DrivenRun(
        "grass",
        "ttempc-tube",
        seed,
        settings,
        REFERENCE_PATH,
        largest=np.array(largest) * generator.uniform(0.5, 1.5),
        half_width=ALONG_GRASS.half_widths[0, Containment.POINTS],
    )


def test_a_tube_is_calibrated_on_runs_in_it_and_keeps_its_design(tmp_path):
    runs = [driven(seed) for seed in range(1, 31)]
    tube = calibrate_tube(runs, 0.9)
    calibration = tube.calibration
    assert calibration is not None
    assert calibration.scale_seeds == [5, 10, 15, 20, 25, 30]
    assert calibration.guaranteed == 23 / 25
    widths = np.array(list(asdict(calibration.half_widths).values()))
    outside = [run for run in runs if run.seed % 5 and np.any(run.largest > widths)]
    assert len(outside) == 1  # the 23rd of 24
    assert replace(tube, calibration=None) == replace(read_tube("grass"), calibration=None)
    text = format_calibration(tube)
    assert "24 scored, 6 for the scale" in text
    assert f"{calibration.half_widths.trailer_across_m:.4f}" in text.splitlines()[-1]
    file = tmp_path / "tube.json"
    file.write_text(to_json(tube))
    assert read_tube(str(file)) == tube


def test_runs_that_calibrate_nothing_are_refused():
    runs = [driven(seed) for seed in range(1, 31)]
    with pytest.raises(InvalidFit, match=r"got 20 runs, a coverage of 0.95 .* takes 23 at least"):
        calibrate_tube(runs[:20], 0.95)
    assert calibrate_tube(runs[:23], 0.95).calibration is not None
    with pytest.raises(InvalidFit, match="seed 1: there twice"):
        calibrate_tube([*runs, runs[0]], 0.9)
    other = replace(runs[7], half_width=1.1 * runs[7].half_width)
    with pytest.raises(InvalidFit, match=r"seed 8: driven in another tube than grass .* 10.0 %"):
        calibrate_tube([*runs[:7], other, *runs[8:]], 0.9)


def test_shipped_tubes_fit_the_default_vehicle():
    assert "grass" in shipped_tubes()
    for name in shipped_tubes():
        along = ReferenceTube.along(read_tube(name).design(), REFERENCE_PATH, TICKS)
        assert np.all(along.free_share > 0.0)


def test_the_certified_tube_of_grass_is_as_narrow_as_promised():
    along, cross = ALONG_GRASS, [QUANTITIES.index(name) for name in ("y_t_e_m", "y_i_e_m")]
    assert along.half_widths[:, cross].max() <= 0.30  # under the published side force law
    on_the_curve = np.abs(REFERENCE_PATH.at(0.2 * np.arange(TICKS)).curvature) > 0.0999
    assert along.free_share[on_the_curve, :2].min() >= 0.199
