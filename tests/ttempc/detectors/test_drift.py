"""Drift told from the ground while driving, and positions that move while the vehicle stands."""

import numpy as np
import pytest

from tests.ttempc.detectors.observed import PERIOD_S, VEHICLE, observed
from ttempc.detectors.interface import Observation, Reaction
from ttempc.detectors.kernel import DETECTORS
from ttempc.detectors.monitors import Monitors
from ttempc.detectors.table import BUILT_IN, DetectorIndex
from ttempc.types import Estimate, Measurement, Sensor

DRIFT = [BUILT_IN[index].name for index in (DetectorIndex.DRIFT, DetectorIndex.DRIFT_SURE)]
AT_REST = BUILT_IN[DetectorIndex.AT_REST].name
GYROS = [BUILT_IN[index].name for index in (DetectorIndex.GYRO_TRACTOR, DetectorIndex.GYRO_TRAILER)]
VELOCITIES = (Sensor.VELOCITY_TRACTOR, Sensor.VELOCITY_TRAILER)
BEHIND_M = 3.0
RADIUS_M = 12.0


class Circle:
    """A vehicle on a circle: a slope moves it aside in proportion to its way, a drift to time."""

    def __init__(
        self,
        names,
        seed=1,
        imu=False,
        held=False,
        velocity=False,
        coherent=True,
        shares=(1.0, 1.0),
    ):
        self.rng = np.random.default_rng(seed)
        self.monitors = Monitors(names)
        self.imu = imu
        self.velocity_from_s = 0.0 if velocity else np.inf  # receivers measure it
        self.coherent = coherent  # the velocities are those of positions that drift
        self.held = held  # receivers hold their positions while the vehicle stands
        self.shares = shares  # of each receiver in the drift
        self.last = {}
        self.drifted = np.zeros(2)  # at the tick before
        self.encoder = 1.0  # factor of its error
        self.turned = 0.0  # error of the estimated heading [rad]

    def drive(
        self,
        seconds,
        slope=0.0,
        drift_mps=0.0,
        from_s=0.0,
        speed_mps=1.0,
        encoder=1.0,
        turn_rad_s=0.0,
    ):
        """Return the times at which each alarm begins [s], by name, and the alarms at the end.

        The slope falls east with side slips as large as `slope`. From `from_s` on the positions
        drift to the north, the encoder is wrong by a factor, and the estimated heading turns away.
        """
        begins = {}
        alarms = ()
        angle = 0.0
        slipped = np.zeros(2)
        for k in range(round(seconds / PERIOD_S)):
            time_s = k * PERIOD_S
            speed = speed_mps(time_s) if callable(speed_mps) else speed_mps
            left = np.array([-np.cos(angle), -np.sin(angle)])  # of the heading angle + 90 deg
            slipped = slipped + PERIOD_S * speed * slope * left[0] * left
            drifted = np.array([0.0, drift_mps * max(0.0, time_s - from_s)])
            moved = slipped, drifted
            wrong_s = max(0.0, time_s - from_s)
            self.encoder = encoder if wrong_s else 1.0
            self.turned = turn_rad_s * wrong_s
            alarms = observed(self.monitors, self._seen(time_s, angle, speed, moved, slope))
            for alarm in alarms:
                begins.setdefault(alarm.detector, time_s)
            angle += PERIOD_S * speed / RADIUS_M
        return begins, alarms

    def _seen(self, time_s, angle, speed, moved, slope):
        slipped, drifted = moved
        ahead = np.array([-np.sin(angle), np.cos(angle)])
        tractor = RADIUS_M * np.array([np.cos(angle), np.sin(angle)]) + slipped
        trailer = tractor - BEHIND_M * ahead
        wheels_mps = self.encoder * speed + self.rng.normal(0.0, 0.03)
        samples = [Measurement(time_s, Sensor.ENCODER, (wheels_mps,))]
        receivers = (Sensor.GNSS_TRACTOR, Sensor.GNSS_TRAILER)
        for sensor, place, share in zip(receivers, (tractor, trailer), self.shares, strict=True):
            at = place + share * drifted + self.rng.normal(0.0, 0.03, 2)
            if self.held and speed == 0.0:
                at = self.last.get(sensor, at) + self.rng.normal(0.0, 1e-4, 2)
            else:
                self.last[sensor] = at
            samples.append(Measurement(time_s, sensor, tuple(at), 1))
        if time_s >= self.velocity_from_s:
            moves = speed * ahead + self.coherent * (drifted - self.drifted) / PERIOD_S
            swings = BEHIND_M * speed / RADIUS_M * np.array([np.cos(angle), np.sin(angle)])
            velocities = moves + self.rng.normal(0.0, 0.03, (2, 2))
            velocities[1] += swings
            for sensor, velocity in zip(VELOCITIES, velocities, strict=True):
                samples.append(Measurement(time_s, sensor, (*velocity, 0.03)))
        self.drifted = drifted
        if self.imu:
            roll = 2.0 * slope * -np.cos(angle)
            tilt = (speed / RADIUS_M, roll, 0.0)
            samples += [
                Measurement(time_s, Sensor(f"imu_{b}"), tilt) for b in ("tractor", "trailer")
            ]
        yaw = angle + 0.5 * np.pi + self.turned
        state = np.array([*tractor, yaw, yaw, 0.0, 0.0, speed])
        estimate = Estimate(time_s, state, 1e-4 * np.eye(7), trailer, 0.0)
        return Observation(time_s, samples, None, estimate, VEHICLE)


@pytest.mark.parametrize("imu", [False, True])
def test_a_drift_slows_then_stops_the_vehicle_and_a_slope_does_not(imu):
    begins, alarms = Circle(DRIFT, imu=imu).drive(90.0, drift_mps=0.12, from_s=40.0)
    assert 40.0 < begins[DRIFT[0]] <= begins[DRIFT[1]] < 90.0
    assert [alarm.reaction for alarm in alarms] == [Reaction.SLOW, Reaction.STOP_ON_PATH]
    assert float(alarms[-1].reason.split()[3]) == pytest.approx(12.0, abs=5.0)
    for speed_mps in (1.0, 4.0):
        begins, _ = Circle(DRIFT, imu=imu).drive(150.0, slope=0.05, speed_mps=speed_mps)
        assert not begins


def test_positions_that_velocities_confirm_slow_the_vehicle_down_and_never_stop_it():
    """Nothing but slip tells such a drift; the first limit is higher."""
    names = [*DRIFT, BUILT_IN[DetectorIndex.VELOCITY].name]
    begins, _ = Circle(names, imu=True, velocity=True).drive(150.0, drift_mps=0.04, from_s=40.0)
    alone, _ = Circle(DRIFT, imu=True).drive(150.0, drift_mps=0.04, from_s=40.0)
    assert [*begins] == [DRIFT[0]]
    assert begins[DRIFT[0]] > alone[DRIFT[0]]


@pytest.mark.parametrize("imu", [False, True])
@pytest.mark.parametrize("encoder", [0.85, 1.15])
def test_an_encoder_that_is_wrong_is_no_drift(encoder, imu):
    """Along the heading it moves both positions as a drift does, but turns with it."""
    begins, _ = Circle(DRIFT, imu=imu).drive(120.0, from_s=40.0, encoder=encoder)
    assert not begins


def test_gyros_are_blamed_where_velocities_confirm_the_positions():
    """A heading that turns away bends dead reckoning; without velocities that is a drift."""
    names = [*DRIFT, *GYROS]
    alone, _ = Circle(names, imu=True).drive(120.0, from_s=40.0, turn_rad_s=0.005)
    assert DRIFT[0] in alone
    assert not set(GYROS) & set(alone)

    names.append(BUILT_IN[DetectorIndex.VELOCITY].name)
    begins, _ = Circle(names, imu=True, velocity=True).drive(90.0, from_s=40.0, turn_rad_s=0.005)
    assert begins[GYROS[0]] == begins[GYROS[1]] > 40.0
    assert DRIFT[0] not in begins or begins[DRIFT[0]] > begins[GYROS[0]]

    drifting = Circle(names, imu=True, velocity=True, coherent=False)
    begins, _ = drifting.drive(90.0, drift_mps=0.03, from_s=40.0)
    assert set(begins) & {*DRIFT, names[-1]}
    assert not set(begins) & set(GYROS)


def test_no_gyro_is_blamed_after_a_drift_beyond_the_second_limit():
    """Velocities come back where the vehicle stands, and move with the positions."""
    circle = Circle([*DRIFT, *GYROS, BUILT_IN[DetectorIndex.VELOCITY].name], imu=True)
    circle.velocity_from_s = 70.0

    def speed_mps(time_s):
        return 1.0 if time_s < 65.0 else 0.0

    begins, alarms = circle.drive(120.0, drift_mps=0.12, from_s=40.0, speed_mps=speed_mps)
    assert begins[DRIFT[1]] < 65.0
    assert not set(begins) & set(GYROS)
    assert {alarm.detector for alarm in alarms} >= set(DRIFT)


def test_the_two_limits_are_seen_in_this_order_and_a_faster_drift_sooner():
    slow, _ = Circle(DRIFT).drive(120.0, drift_mps=0.05, from_s=40.0)
    fast, _ = Circle(DRIFT).drive(120.0, drift_mps=0.20, from_s=40.0)
    assert fast[DRIFT[0]] < slow[DRIFT[0]]


def test_what_is_not_travelled_is_no_evidence_of_slip():
    """The covariance of the filter stays one: symmetric, and without a negative eigenvalue."""
    circle = Circle(DRIFT, imu=True)
    circle.drive(60.0)
    for receiver in circle.monitors.record.view(DETECTORS)[0]["drift"]["receivers"]:
        covariance = receiver["covariance"]
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-9, atol=1e-15)
        assert np.linalg.eigvalsh(covariance).min() > -1e-12


def test_what_a_drift_explains_beside_an_encoder_is_what_both_explain_less_its_part():
    """The ratios of the onset that is compared last, against matrices."""
    circle = Circle(DRIFT)
    circle.drive(120.0, drift_mps=0.02, encoder=1.05, from_s=40.0)
    comparison = circle.monitors.record.view(DETECTORS)[0]["drift"]["comparison"]
    information = comparison["information"]
    evidence = comparison["evidence"]
    ratios = comparison["ratios"][-1]

    drift = np.linalg.solve(information[:2, :2], evidence[:2])
    both = evidence @ np.linalg.solve(information, evidence)
    assert ratios["drift_mps"] == pytest.approx(drift)
    assert ratios["drift"] == pytest.approx(evidence[:2] @ drift)
    assert ratios["beside"] == pytest.approx(both - ratios["encoder"])
    assert 0.0 < ratios["beside"] < both


def stops(time_s):
    return 1.0 if time_s < 20.0 else 0.0


@pytest.mark.parametrize(("drift_mps", "drifts"), [(0.0, False), (0.03, True), (-0.05, True)])
def test_positions_that_move_while_the_vehicle_stands_drift(drift_mps, drifts):
    circle = Circle([AT_REST])
    begins, alarms = circle.drive(75.0, drift_mps=drift_mps, speed_mps=stops)
    assert bool(begins) is drifts
    if drifts:
        assert 20.0 < begins[AT_REST] < 70.0
        assert float(alarms[0].reason.split()[3]) == pytest.approx(100 * abs(drift_mps), abs=1.0)


def test_a_receiver_that_holds_its_position_at_rest_gets_no_verdict():
    begins, _ = Circle([AT_REST], held=True).drive(75.0, drift_mps=0.05, speed_mps=stops)
    assert not begins


def test_opposite_drifts_of_both_receivers_are_none_that_they_share():
    shared, _ = Circle(DRIFT).drive(150.0, drift_mps=0.04, from_s=40.0)
    opposite, _ = Circle(DRIFT, shares=(1.0, -1.0)).drive(150.0, drift_mps=0.04, from_s=40.0)
    assert DRIFT[0] in shared
    assert not opposite
