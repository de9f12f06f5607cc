# ---
# jupyter:
#   jupytext:
#     text_representation:
#       extension: .py
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     language: python
#     name: python3
# ---


# %% [markdown]
# # Lecture 2: estimation with slip
#
# Forty-five minutes. A receiver tells where a tractor is, not which way it slides. You write a
# Kalman filter for a tractor on a wet slope, see that it is wrong and sure of itself, give it the
# slip as a state, and test whether it now knows how wrong it is.
#
# You need: Gaussian distributions, the Kalman filter for linear systems.

# %%
import math
from dataclasses import dataclass

import matplotlib.pyplot as plt
import numpy as np
from scipy.stats import chi2

from proving_ground import load, simulate
from ttempc import Vehicle

# %% [markdown]
# ## 1. A drive, with what its sensors measured and with the truth
#
# The field is MuJoCo: the truth is known to the last bit, and no filter may look at it.
# `/measurement` has a row wherever a sensor delivered a sample, NaN where another did not.

# %%
name, scenario = load("wet-slope", ["path={kind='headland', passes=2, length_m=10}"])
summary, record = simulate(name, scenario, seed=1)
measured = record["/measurement"]
truth = record["/state"]

true_xy = np.column_stack([truth["x_t_m"], truth["y_t_m"]])
true_yaw = np.unwrap(truth["psi_t_rad"])
velocity = np.gradient(true_xy, truth.time_s, axis=0)
moves_along = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
true_slip = np.degrees(moves_along - true_yaw)
true_slip[np.hypot(*velocity.T) < 0.5] = math.nan  # the course of a vehicle at rest is noise

figure, axes = plt.subplots(figsize=(7, 2.4), layout="constrained")
axes.plot(truth.time_s, true_slip, linewidth=0.8)
axes.set(xlabel="time [s]", ylabel="course less heading [deg]", ylim=(-8, 8))
print(f"{summary.status}: {len(measured.time_s)} rows of samples in {measured.time_s[-1]:.0f} s")

# %% [markdown]
# The rear axle does not move where the tractor points. Along the first pass it slips to one side,
# after the turn to the other: seen from the map it always slips downhill.
#
# ## 2. A filter without slip
#
# State: position, yaw, and the share $s$ by which driven wheels turn faster than the tractor
# moves, $(x, y, \psi, s)$. Encoder and steering angle are inputs of the prediction,
#
# $$\dot x = (1 - s)\, v \cos\psi, \quad \dot y = (1 - s)\, v \sin\psi, \quad
# \dot\psi = (1 - s) \frac{v \tan\delta}{L_t},$$
#
# and positions correct it. The receiver on the trailer makes a compass of the pair: the line from
# one axle point to the other, less the bends that the sensors of hitch and trailer steering tell,
# is the heading of the tractor. The extended Kalman filter linearises both at the estimate.
# `Model` says what differs between the filters of this lecture: how a disturbance, appended to the
# state, moves the vehicle aside.


# %%
@dataclass(frozen=True)
class Model:
    """How persistent disturbances make the rear axle slip."""

    label: str
    initial_sd: tuple[float, ...] = ()  # of each disturbance [rad]
    walk: float = 0.0  # random walk of each [rad/sqrt(m)]

    def slip(self, state):
        """Return the side slip [rad] at a state."""
        side = state[4:]
        if len(side) == 1:  # turns with the vehicle
            return side[0]
        if len(side) == 2:  # a vector, fixed in the map
            return -math.sin(state[2]) * side[0] + math.cos(state[2]) * side[1]
        return 0.0


vehicle = Vehicle()
GNSS_SD = 0.03  # of a position on each axis [m]
COMPASS_SD = math.radians(1.5)  # 3 cm twice over 2.4 m, and 1 deg of each angle sensor
BUMPS = 0.01  # noise of the position [m/sqrt(m)]
TURNS = 0.04  # noise of the yaw, from the front axle's slip [rad/sqrt(m)]
WHEELS = 0.05  # random walk of the share s [1/sqrt(m)]


def moved(state, model, distance, steering):
    """Return the state after a distance along the wheels."""
    distance *= 1.0 - state[3]
    course = state[2] + model.slip(state)
    after = state.copy()
    after[0] += distance * math.cos(course)
    after[1] += distance * math.sin(course)
    after[2] += distance * math.tan(steering) / vehicle.wheelbase
    return after


def jacobian(function, at):
    """Return the derivative of a function of one vector, by central differences."""
    size = 1e-5
    columns = [(function(at + h) - function(at - h)) / (2.0 * size) for h in size * np.eye(len(at))]
    return np.array(columns).T


def compass(row, beta, delta_i, near):
    """Return the tractor's heading [rad] from both receivers, as the angle nearest to `near`."""
    east = measured["gnss_tractor_x_m"][row] - measured["gnss_trailer_x_m"][row]
    north = measured["gnss_tractor_y_m"][row] - measured["gnss_trailer_y_m"][row]

    # From the trailer's axle to the tractor's, seen from the tractor
    bend = beta + delta_i
    ahead = vehicle.hitch_offset + vehicle.drawbar_length * math.cos(beta)
    ahead += vehicle.trailer_length * math.cos(bend)
    left = -vehicle.drawbar_length * math.sin(beta) - vehicle.trailer_length * math.sin(bend)
    heading = math.atan2(north, east) - math.atan2(left, ahead)
    return near + math.remainder(heading - near, math.tau)


def filtered(model):
    """Return times (n,), states (n, 4 + side slips) and covariances, one for each position."""
    size = 4 + len(model.initial_sd)
    state = np.zeros(size)
    state[:3] = *true_xy[0], true_yaw[0]  # a start that is known well, to keep the lecture short
    covariance = np.diag(np.square([GNSS_SD, GNSS_SD, 0.03, 0.1, *model.initial_sd]))
    speed = steering = beta = delta_i = 0.0
    last_s = 0.0
    times, states, covariances = [], [], []
    for row, time_s in enumerate(measured.time_s):
        # Predict over the time since the last row, with the last readings of wheels and steering
        distance = speed * (time_s - last_s)
        last_s = time_s

        def move(z, distance=distance, steering=steering):
            return moved(z, model, distance, steering)

        transition = jacobian(move, state)
        state = move(state)
        walks = np.full(size, model.walk)
        walks[:4] = BUMPS, BUMPS, TURNS, WHEELS
        covariance = transition @ covariance @ transition.T
        covariance += abs(distance) * np.diag(np.square(walks))

        if math.isfinite(measured["encoder_mps"][row]):
            speed = measured["encoder_mps"][row]
        if math.isfinite(measured["steering_tractor_rad"][row]):
            steering = measured["steering_tractor_rad"][row]
            beta = measured["hitch_rad"][row]
            delta_i = measured["steering_trailer_rad"][row]

        # Correct by a position and the compass
        seen_now = np.array(
            [
                measured["gnss_tractor_x_m"][row],
                measured["gnss_tractor_y_m"][row],
                compass(row, beta, delta_i, near=state[2]),
            ]
        )
        if not np.isfinite(seen_now).all():
            continue
        seen = np.eye(3, size)
        noise = np.diag([GNSS_SD**2, GNSS_SD**2, COMPASS_SD**2])
        innovation_covariance = seen @ covariance @ seen.T + noise
        gain = covariance @ seen.T @ np.linalg.inv(innovation_covariance)
        state = state + gain @ (seen_now - state[:3])
        covariance = (np.eye(size) - gain @ seen) @ covariance
        times.append(time_s)
        states.append(state.copy())
        covariances.append(covariance.copy())
    return np.array(times), np.array(states), np.array(covariances)


# %% [markdown]
# ## 3. Is it right, and does it know?
#
# Two questions to every filter. How large is its error? And is the error as large as it says? The
# second one is the *normalised estimation error squared*, $e^\top P^{-1} e$. Where the filter is
# consistent it has the chi-squared distribution of as many degrees of freedom as $e$ has entries:
# 95 % of the time it is below 7.8 for three.


# %%
def errors_of(times, states):
    """Return the errors (n, 3) against the truth: ahead, to the left [m], yaw [rad]."""
    at = [np.interp(times, truth.time_s, column) for column in (*true_xy.T, true_yaw)]
    off = states[:, :3] - np.array(at).T
    ahead = off[:, 0] * np.cos(at[2]) + off[:, 1] * np.sin(at[2])
    left = off[:, 1] * np.cos(at[2]) - off[:, 0] * np.sin(at[2])
    return np.column_stack([ahead, left, np.remainder(off[:, 2] + np.pi, 2.0 * np.pi) - np.pi])


def judged(model):
    """Print error and consistency of a model's filter; return its times and errors."""
    times, states, covariances = filtered(model)
    errors = errors_of(times, states)
    raw = states[:, :3] - np.column_stack(
        [np.interp(times, truth.time_s, column) for column in (*true_xy.T, true_yaw)]
    )
    raw[:, 2] = errors[:, 2]
    nees = np.einsum("ni,nij,nj->n", raw, np.linalg.inv(covariances[:, :3, :3]), raw)
    settled = times > 8.0
    left_cm = 100.0 * np.sqrt(np.mean(errors[settled, 1] ** 2))
    yaw_deg = np.degrees(np.sqrt(np.mean(errors[settled, 2] ** 2)))
    inside = np.mean(nees[settled] < chi2.ppf(0.95, 3))
    print(
        f"{model.label:26} across {left_cm:4.1f} cm, yaw {yaw_deg:4.2f} deg, "
        f"NEES {np.mean(nees[settled]) / 3:5.2f} of 1, within its 95 %: {100 * inside:3.0f} %"
    )
    return times, errors


MODELS = (
    Model("no slip"),
    Model("slip of the vehicle", initial_sd=(0.05,), walk=0.004),
    Model("slip of the map", initial_sd=(0.05, 0.05), walk=0.004),
)
figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
axes.set(xlabel="time [s]", ylabel="estimate to the left of the truth [cm]")
for model, style in zip(MODELS, ("-", "--", ":"), strict=True):
    times, errors = judged(model)
    axes.plot(times, 100.0 * errors[:, 1], style, label=model.label, linewidth=1.0)
    axes.legend()

# %% [markdown]
# The filter without slip predicts along its heading and is pushed back by each position: it lags
# to the downhill side, always, and $P$ does not say so. Less than half of its estimates lie where
# it claims 95 %. Slip as a state more than halves the error, and the filter then knows how wrong
# it is. The yaw hardly gains: the compass tells it.
#
# ## 4. Which slip?
#
# One that turns with the vehicle has to be learnt again after every turn. A vector that stays in
# the map keeps its value, because the slope stays where it is: on this field it points south,
# downhill.

# %%
figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
axes.plot(truth.time_s, true_slip, color="0.8", label="true")
for model, style in zip(MODELS[1:], ("--", ":"), strict=True):
    times, states, _ = filtered(model)
    slips = np.degrees([model.slip(state) for state in states])
    axes.plot(times, slips, style, label=model.label, linewidth=1.2)
axes.set(xlabel="time [s]", ylabel="side slip [deg]", ylim=(-8, 8))
axes.legend()
east, north = np.degrees(filtered(MODELS[2])[1][-1, 4:])
print(f"slip of the map at the end: {east:.1f} deg to the east, {north:.1f} deg to the north")

# %% [markdown]
# `ttempc` has both parts, and eighteen states more ([method](../method.md#estimation)). An
# estimator of your own drives with `controller.estimator = "module:Name"`
# ([how](../controller.md)).
#
# ## Exercises
#
# 1. Set `GNSS_SD` to 0.01. What happens to NEES, and to the error? Which of the two tells you that
#    you were wrong, if you have no truth? (Print the innovations, normalised by
#    `innovation_covariance`.)
# 2. The walk of 0.004 was guessed. Sum the logarithm of the likelihood of the innovations over the
#    drive and find the most likely walk. Does it give the smallest error?
# 3. Put a gyro in: the yaw rate of the tractor in `/measurement`, after `load("wet-slope",
#    ["sensors.imu.on=true"])`. What does its bias do to the yaw, and how would you estimate it?
# 4. Write the filter without Jacobians by differences, and test yours against them.
