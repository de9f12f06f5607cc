"""Command path of the actuators, by itself and in the plant."""

import math

import numpy as np
import pytest
from proving_ground.testbed.actuation.actuators import (
    Actuators,
    ActuatorSpecification,
    HydrostatValve,
    SteeringValve,
    past_dead_band,
)
from proving_ground.testbed.errors import InvalidPlant
from proving_ground.testbed.ground import terrain
from proving_ground.testbed.ground.soil import SoilMap
from proving_ground.testbed.simulation.plant import Plant
from proving_ground.testbed.vehicle.vehicle import Steering, read_vehicle
from pydantic import ValidationError

from ttempc.types import Command

TIMESTEP_S = 0.002
STEERING = (Steering(35.0, 45.0, 0.2), Steering(25.0, 30.0, 0.3))
DEG = math.pi / 180.0
OLD = SteeringValve(dead_time_s=0.15, dead_band_deg=0.5, backlash_deg=1.0)


def path(timestep=TIMESTEP_S, **specification):
    return Actuators(ActuatorSpecification(**specification), timestep, STEERING)


def driven(actuators, commands, lag_s=0.0, hp=0.0):
    """Set points (n, 3) for one command a physics step, with servos of a first-order lag."""
    state, angles, rows = actuators.start(hp), np.zeros(2), []
    share = 1.0 if lag_s == 0.0 else TIMESTEP_S / lag_s
    for command in commands:
        state = actuators.step(state, Command(*command), *angles.tolist())
        rows.append(actuators.set_points(state))
        angles += share * (np.array(rows[-1][:2]) - angles)
    return np.array(rows)


def front(values):
    return [(value, 0.0, 0.0) for value in values]


# --- pure ------------------------------------------------------------------------------------


def test_with_everything_off_a_set_point_is_the_command_bit_for_bit():
    actuators = path()
    commands = np.random.default_rng(1).uniform(-0.4, 0.4, (200, 3))
    assert actuators.passive
    np.testing.assert_array_equal(driven(actuators, commands), commands)


@pytest.mark.parametrize("dead_time", [0.002, 0.1, 0.15, 0.5])
def test_commands_arrive_exactly_after_the_dead_time(dead_time):
    late = round(dead_time / TIMESTEP_S)
    valve = SteeringValve(dead_time_s=dead_time)
    actuators = path(front=valve, trailer=valve, hydrostat=HydrostatValve(dead_time_s=dead_time))
    held = np.repeat(np.random.default_rng(2).uniform(0.0, 0.4, (10, 3)), 100, axis=0)  # 0.2 s
    set_points = driven(actuators, held, hp=0.7)
    np.testing.assert_array_equal(set_points[late:], held[:-late])
    np.testing.assert_array_equal(set_points[:late], [[0.0, 0.0, 0.7]] * late)


def test_dead_band_ignores_small_errors_and_is_continuous_beyond():
    band = 0.5 * DEG
    errors = np.linspace(-2.0, 2.0, 4001) * DEG
    sent = np.array([past_dead_band(0.0, error, 0.0, band) for error in errors])
    inside = np.abs(errors) <= band
    np.testing.assert_array_equal(sent[inside], 0.0)
    beyond = np.sign(errors[~inside]) * (np.abs(errors[~inside]) - band)
    np.testing.assert_allclose(sent[~inside], beyond, atol=1e-15)
    assert np.abs(np.diff(sent)).max() < 1.01 * np.diff(errors).max()


def test_an_axis_stops_a_dead_band_short_and_stays_until_the_error_is_as_large_again():
    actuators = path(front=SteeringValve(dead_band_deg=0.5))
    back = np.linspace(10.0, 9.01, 500)  # towards where it stands: 9.5, error 0.49 at the end
    commands = DEG * np.array([*[10.0] * 1500, *back, *[8.5] * 1500])
    set_points = driven(actuators, front(commands), lag_s=0.15)[:, 0] / DEG
    np.testing.assert_allclose(set_points[1499:2000], 9.5, atol=1e-9)
    assert set_points[-1] == pytest.approx(9.0)


def test_a_command_that_comes_towards_a_moving_axis_locks_it_where_it_is():
    band, present = 0.5 * DEG, 3.0 * DEG
    assert past_dead_band(9.5 * DEG, present + 0.4 * DEG, present, band) == present


def test_hysteresis_of_the_play_is_as_wide_as_the_play():
    play = 1.0 * DEG
    actuators = path(front=SteeringValve(backlash_deg=1.0))
    command = 5.0 * DEG * np.sin(np.linspace(0.0, 4.0 * math.pi, 4001))
    wheel = driven(actuators, front(command))[2000:, 0]  # the second loop
    command = command[2000:]
    rising = np.gradient(command) > 0.0
    up = np.interp(0.0, command[1500:], wheel[1500:])
    down = np.interp(0.0, command[1500:500:-1], wheel[1500:500:-1])
    assert rising[1600]
    assert not rising[1000]
    assert down - up == pytest.approx(play, abs=1e-6)
    assert wheel.max() == pytest.approx(5.0 * DEG - 0.5 * play)


def test_commands_are_rounded_to_the_resolution():
    step = 0.25 * DEG
    actuators = path(front=SteeringValve(resolution_deg=0.25))
    commands = np.random.default_rng(4).uniform(-0.5, 0.5, 300)
    sent = driven(actuators, front(commands))[:, 0]
    np.testing.assert_allclose(sent / step, np.round(sent / step), atol=1e-9)
    assert np.abs(sent - commands).max() <= 0.5 * step + 1e-12


def test_an_axis_turns_to_each_side_at_its_share_of_lag_and_largest_rate():
    lag = STEERING[0].lag_s
    actuators = path(front=SteeringValve(flow_left=1.0, flow_right=0.6))
    for flow, sign in ((1.0, 1.0), (0.6, -1.0)):
        for goal, steps in ((1.0, 500), (30.0, 100)):  # [deg]; the valve is not, and is fully open
            commands = front([sign * goal * DEG] * steps)
            angle = np.zeros(steps + 1)  # of the servo, as in `driven`
            for k, point in enumerate(driven(actuators, commands, lag_s=lag)[:, 0] * sign / DEG):
                angle[k + 1] = angle[k] + TIMESTEP_S / lag * (point - angle[k])
            time_s = TIMESTEP_S * np.arange(steps + 1)
            if goal == 1.0:
                np.testing.assert_allclose(angle, 1.0 - np.exp(-flow * time_s / lag), atol=0.005)
            else:
                rate = np.diff(angle) / TIMESTEP_S
                np.testing.assert_allclose(rate, flow * STEERING[0].rate_degps, rtol=1e-9)


def test_impossible_valves_are_refused_by_their_keys():
    keys = ("dead_time_s", "dead_band_deg", "backlash_deg", "resolution_deg", "flow_left")
    for name, value in [*((key, bad) for key in keys for bad in (-0.1, math.nan)), (keys[0], 2.1)]:
        with pytest.raises(ValidationError, match=name):
            SteeringValve(**{name: value})
    with pytest.raises(InvalidPlant, match=r"front\.dead_time_s: 0\.15 s"):
        path(timestep=0.004, front=OLD)
    for name in ("dead_band", "backlash", "resolution"):
        valve = SteeringValve(**{f"{name}_deg": 26.0})
        path(front=valve)
        with pytest.raises(InvalidPlant, match=rf"trailer\.{name}_deg: got 26, .* 25"):
            path(trailer=valve)


# --- in the plant ----------------------------------------------------------------------------


def plant_with(actuators=None):
    ground = terrain.flat((60.0, 40.0))
    return Plant(read_vehicle(), ground, SoilMap.named("hard"), actuators=actuators)


def qpos_after(plant, strides):
    plant.reset(-10.0, 0.0, 0.0, 0.7)
    rows = []
    for command, steps in strides:
        plant.advance(command, steps)
        rows.append(plant.data.qpos.copy())
    return np.array(rows)


def test_a_steered_axle_stops_short_by_dead_band_and_half_the_play():
    plant = plant_with(ActuatorSpecification(front=OLD))
    plant.reset(-10.0, 0.0, 0.0, 0.7)
    reached = plant.advance(Command(10.0 * DEG, 0.0, 0.5), 1500)
    assert reached.delta_t / DEG == pytest.approx(10.0 - 0.5 - 0.5, abs=0.05)
    np.testing.assert_allclose(reached.set_points / DEG, [9.0, 0.0, 0.5 / DEG], atol=0.02)
    back = plant.advance(Command(8.0 * DEG, 0.0, 0.5), 1500)
    assert back.delta_t / DEG == pytest.approx(8.0 + 0.5 + 0.5, abs=0.05)


def test_a_restored_plant_goes_on_identically_with_commands_under_way():
    hydrostat = HydrostatValve(dead_time_s=0.3)
    plant = plant_with(ActuatorSpecification(front=OLD, trailer=OLD, hydrostat=hydrostat))
    plant.reset(-10.0, 0.0, 0.0, 0.7)
    plant.advance(Command(0.2, -0.1, 0.8), 100)
    plant.advance(Command(-0.1, 0.1, 0.2), 10)  # three commands between sender and servos
    before = plant.snapshot()
    arrived, under_way = before.valves[6], before.valves[-150:]  # of the hydrostat
    assert len({arrived, *under_way}) == 3
    first = plant.advance(Command(0.05, 0.0, 0.5), 400).body_xyz
    plant.restore(before)
    np.testing.assert_array_equal(plant.advance(Command(0.05, 0.0, 0.5), 400).body_xyz, first)
