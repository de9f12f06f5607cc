"""Foresight: a ground under both axles is foretold, and nothing where there is no likeness."""

import copy
from collections.abc import Callable

import numpy as np
import pytest

from ttempc.layout import ESTIMATE, SAMPLE, SampleColumn, estimate_row
from ttempc.learning.foresight import Foresight
from ttempc.models.kinematics import articulated, trailer_point
from ttempc.sensors import SensorIndex
from ttempc.types import Disturbance, Estimate, FloatArray, Input, State
from ttempc.vehicle import Vehicle

VEHICLE = Vehicle()
BETWEEN_M = VEHICLE.hitch_offset + VEHICLE.drawbar_length + VEHICLE.trailer_length
Ground = Callable[[float], float]
"""A slip [rad] or a height [m] over the distance [m]."""


def bumps(seed: int, size: float) -> Ground:
    """Return random heights each 0.7 m with a standard deviation, and linear between them."""
    heights = np.random.default_rng(seed).normal(0.0, size, 400)
    places = 0.7 * np.arange(-10, len(heights) - 10)
    return lambda x: float(np.interp(x, places, heights))


def nothing(_: float) -> float:
    return 0.0


class Drive:
    """A straight drive of exact kinematics over grounds, seen without errors.

    Disturbances of the estimate are 0: all slips are beside them. The roll is what its IMU shows.
    """

    def __init__(
        self,
        slip_t: Ground,
        slip_i: Ground,
        roll: Ground | None = None,
        speed_mps: float = 1.0,
        period_s: float = 0.2,
        curvature: float = 0.0,
    ) -> None:
        self.foresight = Foresight(VEHICLE, period_s)
        self.slip_t = slip_t
        self.slip_i = slip_i
        self.roll = roll
        self.period_s = period_s
        self.state = np.zeros(len(State))
        self.state[State.V] = speed_mps
        self.inputs = np.zeros(len(Input))
        self.inputs[Input.DELTA_T] = np.arctan(VEHICLE.wheelbase * curvature)
        self.inputs[Input.HP] = speed_mps / VEHICLE.speed_gain
        self.state[State.DELTA_T] = self.inputs[Input.DELTA_T]
        self.driven_m = 0.0
        self.time_s = 0.0

    @property
    def row(self) -> FloatArray:
        """Record `ESTIMATE` of the present state."""
        return estimate_row(
            Estimate(
                self.time_s,
                self.state.copy(),
                np.eye(len(State)),
                trailer_point(self.state, VEHICLE),
                hitch_angle=0.0,
            )
        )

    def tick(self, usable: bool = True) -> None:
        """Drive for a period, and show it to the foresight."""
        samples = []
        steps = max(4, round(self.period_s / 0.04))
        span_s = self.period_s / steps
        disturbance = np.zeros(len(Disturbance))
        for _ in range(steps):
            disturbance[Disturbance.SLIP_T] = self.slip_t(self.driven_m)
            disturbance[Disturbance.SLIP_I] = self.slip_i(self.driven_m - BETWEEN_M)
            middle = self.state + 0.5 * span_s * self._rate(self.state, disturbance)
            self.state += span_s * self._rate(middle, disturbance)
            self.driven_m += self.state[State.V] * span_s
            self.time_s += span_s
            if self.roll is not None:
                row = np.zeros(SAMPLE)
                row[SampleColumn.TIME_S] = self.time_s
                row[SampleColumn.SENSOR] = SensorIndex.IMU_TRACTOR
                row[SampleColumn.SECOND] = self.roll(self.driven_m)
                samples.append(row)
        rows = np.array(samples).reshape(-1, SAMPLE)
        self.foresight.observe(rows, self.row, usable)

    def _rate(self, state: FloatArray, disturbance: FloatArray) -> FloatArray:
        return articulated(state, self.inputs, VEHICLE, disturbance)

    def until(self, distance_m: float) -> None:
        """Drive on up to a distance."""
        while self.driven_m < distance_m:
            self.tick()

    def forecast(self, distance_m: float, stage: int) -> tuple[FloatArray, FloatArray]:
        """Drive on; return forecast and true slips of the period that begins `stage` later."""
        found = []
        while self.driven_m < distance_m:
            self.tick()
            ahead = self.foresight.ahead(0, stage + 1)[stage]
            step = self.state[State.V] * self.period_s
            begin = self.driven_m - BETWEEN_M + stage * step
            places = begin + step * np.array([0.1, 0.3, 0.5, 0.7, 0.9])
            true = np.mean([self.slip_i(place) for place in places])
            found.append((ahead[Disturbance.SLIP_I], true))
            assert ahead[Disturbance.SLIP_T] == ahead[Disturbance.STEERING] == 0.0
        forecasts, slips = np.array(found).T
        return forecasts, slips


def explained(forecast: FloatArray, slip: FloatArray) -> float:
    """Return the share of the variance of a slip that its forecast explains."""
    return float(1.0 - np.mean((slip - forecast) ** 2) / np.mean(slip**2))


@pytest.mark.parametrize(
    ("speed_mps", "period_s", "stage"),
    [(1.0, 0.2, 0), (1.0, 0.2, 7), (2.5, 0.2, 1), (4.2, 0.2, 0), (1.5, 0.1, 8), (2.0, 0.04, 10)],
)
def test_a_slip_that_both_axles_meet_is_foretold(
    speed_mps: float, period_s: float, stage: int
) -> None:
    ground = bumps(1, 0.03)
    drive = Drive(ground, lambda x: 0.8 * ground(x), None, speed_mps, period_s)
    drive.until(60.0)
    # Over the long periods of fast drives the motion between two estimates is a mean
    enough = 0.75 if speed_mps * period_s < 0.4 else 0.4
    assert explained(*drive.forecast(120.0, stage)) > enough
    assert drive.foresight.confidence > 0.2  # the trailer is beside the tractor's path at times


def test_a_trailer_that_tilts_where_its_tractor_did_is_foretold_by_the_roll() -> None:
    # An axle h above the ground steps aside by h times the roll: the slip is h d(roll)/dx.
    ground = bumps(2, 0.02)
    height_m = 0.3

    def slope(x: float) -> float:
        return (ground(x + 0.01) - ground(x - 0.01)) / 0.02

    drive = Drive(nothing, lambda x: -height_m * slope(x), ground)
    drive.until(60.0)
    assert explained(*drive.forecast(90.0, 3)) > 0.75


def test_nothing_is_foretold_where_there_is_no_likeness() -> None:
    drive = Drive(bumps(3, 0.03), bumps(4, 0.03), bumps(5, 0.03))
    drive.until(60.0)
    forecasts, slips = drive.forecast(120.0, 0)
    assert np.mean(forecasts**2) < 0.02 * np.mean(slips**2)
    assert drive.foresight.confidence < 0.25


def test_nothing_is_foretold_before_the_warm_up_and_before_the_tractor_was_there() -> None:
    ground = bumps(1, 0.03)
    drive = Drive(ground, ground)
    drive.until(8.0)
    assert drive.foresight.confidence == 0.0
    drive.until(60.0)
    ahead = drive.foresight.ahead(0, 40)[:, Disturbance.SLIP_I]
    periods = int(BETWEEN_M / 0.2)
    assert np.abs(ahead[: periods - 3]).min() > 0.0
    assert (ahead[periods + 1 :] == 0.0).all()


@pytest.mark.parametrize("what", ["reverse", "fault", "jump"])
def test_a_record_with_a_gap_foretells_nothing_until_the_trailer_has_passed_it(what: str) -> None:
    ground = bumps(1, 0.03)
    drive = Drive(ground, ground)
    drive.until(60.0)
    assert np.abs(drive.foresight.ahead(0, 5)).max() > 0.0
    if what == "reverse":
        drive.state[State.V] *= -1.0
        drive.foresight.observe(np.zeros((0, SAMPLE)), drive.row, True)
        drive.state[State.V] *= -1.0
    elif what == "fault":
        drive.tick(usable=False)
    else:
        drive.time_s += 30.0
    drive.tick()
    assert (drive.foresight.ahead(0, 5) == 0.0).all()
    before = drive.foresight.confidence
    drive.until(66.0)
    assert np.abs(drive.foresight.ahead(0, 5)).max() > 0.0
    assert before == 0.0 or drive.foresight.confidence > 0.5


def test_a_trailer_on_another_path_is_not_foretold() -> None:
    ground = bumps(1, 0.03)
    drive = Drive(ground, ground)
    drive.until(60.0)
    near = drive.foresight.confidence
    row = drive.row
    row.view(ESTIMATE)[0]["trailer_xy"] += 0.5
    drive.foresight.observe(np.zeros((0, SAMPLE)), row, True)
    assert drive.foresight.confidence < 0.01 * near


def test_forecasts_of_a_place_are_those_of_any_speed_and_period() -> None:
    ground = bumps(6, 0.03)
    pairs = ((1.0, 0.2), (2.0, 0.1))
    drives = [Drive(ground, ground, None, speed, period) for speed, period in pairs]
    means = []
    for drive in drives:
        drive.until(60.0)
        offset = drive.driven_m % 0.2
        assert offset == pytest.approx(0.0, abs=1e-6) or offset == pytest.approx(0.2, abs=1e-6)
        means.append(drive.foresight.ahead(0, 8)[:, Disturbance.SLIP_I])
    assert means[0] == pytest.approx(means[1], abs=0.1 * np.abs(means[0]).max())


def test_a_memory_brings_a_foresight_back() -> None:
    ground = bumps(1, 0.03)
    drive = Drive(ground, ground)
    drive.until(40.0)
    memory = copy.deepcopy(drive.foresight.memory())
    twin = copy.deepcopy(drive)
    drive.until(45.0)
    after = drive.foresight.ahead(0, 8)
    drive.foresight.restore(memory)
    assert drive.foresight.confidence == twin.foresight.confidence
    twin.until(45.0)
    assert (twin.foresight.ahead(0, 8) == after).all()
