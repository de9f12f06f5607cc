"""Options of the controllers: validated, and used; warm-up."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from functools import cache

import numpy as np
import pytest

from tests.ttempc.closed_loop import seen_truth
from tests.ttempc.tubes import DESIGN, PERIOD_S, VEHICLE
from ttempc.baselines.lqr import LqrOptions
from ttempc.baselines.nmpc import NmpcOptions
from ttempc.baselines.nmpc_path import NmpcPathOptions
from ttempc.baselines.paper import PaperOptions
from ttempc.baselines.pid import PidOptions
from ttempc.errors import InvalidTuning
from ttempc.guidance.controllers import CONTROLLERS, make_controller, parse_options
from ttempc.laws.options import ArticulatedOptions, MpcOptions
from ttempc.laws.tracking_controller import TrackingController
from ttempc.reference.corridor import Corridor
from ttempc.reference.path import figure_eight, straight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.vehicle import Vehicle

REFERENCE = Reference(straight(20.0), VEHICLE, ConstantSpeed(1.0), corridor=Corridor(0.08))
BEND = Reference(figure_eight(laps=1), VEHICLE, ConstantSpeed(1.0))
INTO_THE_BEND = 60  # tick at which the curvature and its change are not 0
OFFSET = np.array([0.05, 0.1, 0.05, -0.05, 0.01, 0.01, 0.05])
# A value other than the default that changes the command of an estimate beside the reference.
CHANGES = {
    ArticulatedOptions: {
        "horizon": 12,
        "moves": 2,
        "output_weight": (1.0, 0.3, 1.0, 1.0),
        "step_weight": (5.0, 1.0, 0.02),
        "input_bound": (0.01, 0.3, 0.5),
        "input_rate": (0.02, 0.6, 0.3),
        "robust": False,
        "saturation": (0.05, 0.1, 0.1),
        "input_weight": (3.0, 0.3, 0.3),
        "memory_s": 0.5,
        "disturbances": False,
        "corridor": False,
    },
    PaperOptions: {
        "horizon": 5,
        "moves": 1,
        "output_weight": (1.0, 0.1, 0.0, 1.0, 1.0, 0.0, 0.0),
        "step_weight": (5.0, 1.0, 1.0),
        "input_bound": (0.01, 0.1, 0.1),
        "input_rate": (0.02, 0.6, 0.3),
        "robust": False,
        "saturation": (0.02, 0.1, 0.1),
        "proportional": (0.2, 1.0, 10.0),
        "derivative": (0.4, 2.0, 20.0),
        "hitch_sign": -1,
        "hitch_angle": "reference",
        "feedforward": "geometry",
        "trailer_speed": "exact",
        "trailer_error_frame": "tractor",
        "robust_sign": 1,
        "hp_full_scale": 100,
        "nominal": "model",
        "mpc_start": "nominal",
        "yaw_by_speed": True,
        "hp_in_cost": "fraction",
        "steering_in_cost": "rad/s",
    },
    MpcOptions: {"horizon": 12, "step_weight": (5.0, 1.0, 0.02)},
    LqrOptions: {
        "output_weight": (1.0, 0.3, 1.0, 1.0),
        "step_weight": (5.0, 1.0, 1.0),
        "swing_deg": 9.0,
    },
    PidOptions: {
        "lag_ratio": 8.0,
        "trailer_lag_ratio": 8.0,
        "swing_deg": 9.0,
        "least_speed_mps": 1.5,
    },
    NmpcOptions: {"horizon": 12, "step_weight": (5.0, 1.0, 0.02), "iterations": 1},
    NmpcPathOptions: {"moves": 5, "look_ahead_m": 0.8, "parametrised_by": "time"},
}
NAMES = {entry.options: name for name, entry in reversed(CONTROLLERS.items()) if entry.options}


def make(options, reference):
    name, design = NAMES[type(options)], DESIGN if type(options) is MpcOptions else None
    return make_controller(name, VEHICLE, reference, PERIOD_S, design, asdict(options))


@cache
def commands(options):
    """Return the commands on estimates beside the reference, (8, 3), before the limits."""
    bend = isinstance(options, PaperOptions)  # some readings differ where the road bends alone
    reference, first = (BEND, INTO_THE_BEND) if bend else (REFERENCE, 0)
    controller = make(options, reference)
    generator = np.random.default_rng(61)
    totals = []
    for k in range(first, first + 8):
        state = reference.at(k * PERIOD_S).state + OFFSET + 0.01 * generator.normal(size=7)
        estimate = seen_truth(state, k * PERIOD_S, VEHICLE)
        disturbed = replace(estimate, disturbance=np.array([0.03, 0.02, -0.02, -0.03, 0.05]))
        totals.append(controller.step(disturbed, k).diagnostics.total)
    return np.array(totals)


@pytest.mark.parametrize(
    ("options", "name"), [(options, name) for options, names in CHANGES.items() for name in names]
)
def test_every_option_changes_the_commands(options, name):
    plain = options()
    changed = replace(plain, **{name: CHANGES[options][name]})
    assert not np.array_equal(commands(changed), commands(plain))


def test_a_shorter_period_has_a_horizon_of_the_same_time_and_ramps_of_the_same_cost():
    """Half the period: twice the steps, each half as large, against twice the sum of errors."""
    vehicle = replace(VEHICLE, wheelbase=2.0 * VEHICLE.wheelbase)
    short, long = (MpcOptions().for_vehicle(vehicle, 2.0, period_s) for period_s in (0.1, 0.2))
    assert (short.horizon, short.moves) == (2 * long.horizon, 2 * long.moves)
    ramp = np.array([0.03, -0.02, 0.1])
    cost = long.moves * np.asarray(long.step_weight) @ ramp**2
    halves = short.moves * np.asarray(short.step_weight) @ (0.5 * ramp) ** 2
    assert halves == pytest.approx(2.0 * cost)


@pytest.mark.parametrize("rate_hz", [5.0, 12.5, 25.0, 100.0])
def test_the_unknowns_are_those_of_5_hz_at_every_rate(rate_hz):
    period_s = 1.0 / rate_hz
    options = MpcOptions().for_vehicle(VEHICLE, 1.0, period_s)
    steps = options.free_steps(period_s)
    assert len(steps.stages) == MpcOptions().moves
    assert period_s * steps.periods[1:].mean() == pytest.approx(0.2)
    assert period_s * steps.stages[-1] == pytest.approx(1.0, abs=0.1 + period_s)


def test_the_vehicle_of_the_options_has_them_as_they_are():
    options = MpcOptions().for_vehicle(Vehicle(), 1.0, 0.2)
    np.testing.assert_allclose(options.step_weight, MpcOptions().step_weight)
    assert replace(options, step_weight=MpcOptions().step_weight) == MpcOptions()


def test_impossible_values_are_refused_with_name_and_value():
    for options, name, value in (
        (ArticulatedOptions, "moves", 21),
        (ArticulatedOptions, "step_weight", (1.0, 1.0, 0.0)),
        (ArticulatedOptions, "memory_s", 0.0),
        (ArticulatedOptions, "tube", "yes"),
        (PaperOptions, "hitch_sign", 0),
        (LqrOptions, "output_weight", (1.0, -1.0, 1.0, 1.0)),
        (PidOptions, "lag_ratio", -1.0),
        (NmpcOptions, "iterations", 0),
    ):
        with pytest.raises(InvalidTuning, match=f"{name}: got"):
            options(**{name: value})


KINDS = {entry.options for entry in CONTROLLERS.values() if entry.options}
by_kind = pytest.mark.parametrize("kind", sorted(KINDS, key=lambda kind: kind.__name__))


@by_kind
def test_a_value_of_another_type_is_refused_with_its_name(kind):
    for item in fields(kind):
        for wrong in (None, "wrong", [], ["wrong"], {}, float("nan")):
            with pytest.raises(InvalidTuning, match=rf"^controller\.options\.{item.name}"):
                parse_options(kind, {item.name: wrong})


TICKS = 30
NOISE = np.array([0.02, 0.02, 0.01, 0.01, 0.002, 0.002, 0.02])


def estimates():
    """Return estimates beside the reference, with disturbances."""
    generator = np.random.default_rng(71)
    for k in range(TICKS):
        state = BEND.at(k * PERIOD_S).state + NOISE * generator.normal(size=7)
        disturbance = np.array([0.02, 0.01, -0.01, -0.02, 0.05])
        yield replace(seen_truth(state, k * PERIOD_S, VEHICLE), disturbance=disturbance)


def commands_of_warm_up(name, warm_up_at):
    """Return the commands_of_warm_up (N, 3) of a controller that is warmed up before some ticks."""
    controller = make_controller(name, VEHICLE, BEND, PERIOD_S, DESIGN)
    assert isinstance(controller, TrackingController)
    sent = []
    for k, estimate in enumerate(estimates()):
        if k in warm_up_at:
            controller.warm_up()
        controller.prepare(k)
        sent.append(controller.step(estimate, k).command.as_array())
    return np.array(sent)


@pytest.mark.parametrize("name", CONTROLLERS)
def test_warm_up_changes_no_bit_of_any_command(name):
    cold = commands_of_warm_up(name, warm_up_at=())
    np.testing.assert_array_equal(commands_of_warm_up(name, warm_up_at=(0,)), cold)
    np.testing.assert_array_equal(commands_of_warm_up(name, warm_up_at=(0, 1, 10)), cold)
