"""Map of disturbances by place: what it learns, where, and what it tells."""

import copy

import numpy as np
import pytest

from tests.reference.models.kinematics import advance
from tests.ttempc.sensed_drive import SensedDrive
from ttempc import Guidance, GuidanceSettings, Reference, Vehicle, figure_eight
from ttempc.errors import InvalidPath, InvalidTuning
from ttempc.estimation.ekf import ExtendedKalmanFilter
from ttempc.layout import ESTIMATE, SAMPLE, estimate_row, sample_rows
from ttempc.learning.field import FieldMap, places
from ttempc.models.kinematics import hitch_angle, trailer_point
from ttempc.reference.headland import headland
from ttempc.reference.reference import ConstantSpeed
from ttempc.types import Estimate, State

PERIOD_S = 0.2
VEHICLE = Vehicle()


def reference(laps=2):
    return Reference(figure_eight(laps=laps), VEHICLE, ConstantSpeed(1.0))


def row(state):
    point, angle = trailer_point(state, VEHICLE), hitch_angle(state)
    return estimate_row(Estimate(0.0, state, np.eye(7), point, angle))


def learnt(true, laps=2):
    """Return a map that has seen a vehicle whose disturbances are `true` of the distance [m]."""
    field, grid = FieldMap(reference(laps), PERIOD_S), reference(laps).on_grid(PERIOD_S)
    state = grid.state[0].copy()
    for k, inputs in enumerate(grid.inputs):
        field.observe(k, row(state), True)
        for n in range(5):
            slips = np.append(true(k * PERIOD_S + 0.04 * n), [0.0, 0.0])
            state = advance(state, inputs, VEHICLE, 0.04, slips)
    return field


def test_a_pass_shows_the_slips_and_the_steering_that_the_vehicle_has():
    true = np.array([0.02, -0.03, 0.015])
    map_rows = learnt(lambda s: true, laps=1).rows
    np.testing.assert_allclose(map_rows[:, 6:9], np.tile(true, (len(map_rows), 1)), atol=2e-3)


def test_places_are_those_of_the_first_lap_at_the_same_pose():
    grid = reference(3).on_grid(PERIOD_S)
    place = places(grid.state[:, :3], grid.distance_m)
    lap_m = reference(3).path.lap_m
    first = grid.distance_m < lap_m - 0.5
    assert (place[first] == np.flatnonzero(first)).all()  # the crossing is no place of both ways
    later = grid.distance_m > lap_m + 0.5
    gap = np.abs((grid.distance_m[later] - grid.distance_m[place[later]]) % lap_m)
    assert np.minimum(gap, lap_m - gap).max() < PERIOD_S


def test_changes_add_up_to_what_lies_ahead_and_are_zero_on_the_first_pass():
    field = learnt(lambda s: 0.05 * np.sin(np.array([0.2, 0.25, 0.3]) * s))
    again = FieldMap(reference(), PERIOD_S, earlier=field.rows)
    state = reference().on_grid(PERIOD_S).state
    k = 300
    ahead = again.ahead(k, 20)
    changes = []
    for n in range(k, k + 20):
        changes.append(again.change(n) if n > k else np.zeros(3))
        again.observe(n, row(state[n]), False)
    np.testing.assert_allclose(np.cumsum(changes, axis=0), ahead, atol=1e-12)
    assert np.abs(ahead).max() > 0.005
    fresh = FieldMap(reference(), PERIOD_S)
    assert not fresh.ahead(k, 20).any()
    assert not fresh.change(k).any()


def test_a_slope_that_the_estimate_has_is_no_change():
    slope, grid = np.array([0.03, -0.02]), reference(1).on_grid(PERIOD_S)
    count = len(grid.state)
    headings = grid.state[:, [State.PSI_T, State.PSI_I]]
    known = np.zeros((count, 12))
    known[:, :4], known[:, 4], known[:, 5] = grid.state[:, :4], 1.0, grid.distance_m
    known[:, 6:8] = slope[1] * np.cos(headings) - slope[0] * np.sin(headings)
    known[:, 9:] = 1e-5
    field = FieldMap(reference(1), PERIOD_S, earlier=known)
    unaware = np.abs(field.ahead(100, 40)).max()
    estimate = row(grid.state[0])
    estimate.view(ESTIMATE)["map_disturbance"][0, :2] = slope
    field.observe(0, estimate, True)
    assert np.abs(field.ahead(100, 40)).max() < 0.02 * unaware


@pytest.mark.parametrize("rows", [np.zeros((3, 4)), np.full((2, 12), np.nan)])
def test_what_are_no_rows_of_a_map_are_refused(rows):
    with pytest.raises(InvalidTuning, match="learn_field"):
        Guidance(VEHICLE, figure_eight(), settings=GuidanceSettings(learn_field=rows))


def test_a_headland_of_two_passes_closes():
    path = headland(20.0, 6.0, passes=2, laps=2)
    np.testing.assert_allclose(path.pose(0.0)[:2], path.pose(path.lap_m)[:2], atol=1e-9)
    with pytest.raises(InvalidPath, match="laps"):
        headland(20.0, 6.0, passes=3, laps=2)


def test_a_copy_goes_on_as_the_map_does():
    field = learnt(lambda s: np.full(3, 0.01), laps=1)
    twin = copy.deepcopy(field)
    assert (twin.rows == field.rows).all()


def test_the_filter_moves_by_a_change_and_no_order_of_arrival_matters():
    received, change = SensedDrive(1).run(24).received, np.array([0.02, -0.01, 0.015])
    at_20, last = [], []
    for late, moved in ((True, False), (True, True), (False, True)):
        ekf, held = ExtendedKalmanFilter(VEHICLE), np.empty((0, SAMPLE))
        for k, (samples, command) in enumerate(received):
            rows = np.concatenate([sample_rows(samples), held if k == 21 else held[:0]])
            if late and k == 20:
                held, rows = rows, held
            sent = np.full(3, np.nan) if command is None else command.as_array()
            by = change if moved and k == 20 else np.zeros(3)
            seen = ekf.observe(k * PERIOD_S, rows, sent, by)[0].view(ESTIMATE)[0]
            if k == 20:
                at_20.append(seen["disturbance"][:3].copy())
        last.append(ekf.snapshots()["augmented"][-1, 0])
    np.testing.assert_allclose(at_20[1] - at_20[0], change, rtol=0.01)
    np.testing.assert_array_equal(last[1], last[2])
    assert (last[0] != last[1]).any()
