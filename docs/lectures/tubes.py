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
# # Lecture 3: robustness and tubes
#
# Forty-five minutes. Every model is wrong. You measure by how much, bound it by a set, compute the
# tube in which the vehicle stays around its plan, and keep a crop row with it. Then you take the
# same tube to another field, and see what a proof is worth when its premise is not met.
#
# You need: lecture 1, convex sets.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np
import piqp

from proving_ground import load, simulate
from ttempc import Command, Vehicle
from ttempc.tube import (
    TrackingSystem,
    feedback_gains,
    fit_set,
    invariant_tube,
    outline,
)

# %% [markdown]
# ## 1. A small model
#
# Along a straight line at $v$ = 1 m/s, with the distance $y$ to the left of the line, the heading
# error $\theta$ and the steering angle $u$,
#
# $$\dot y = v\,\theta, \qquad \dot\theta = \frac{v}{L_t}\,u .$$
#
# It leaves out nearly everything: lag and dead time of the valve, slip, the trailer that pushes,
# bumps, the error of the filter. All of that is the *residual*, what the next state is more than
# the model says.

# %%
PERIOD_S = 0.2
SPEED = 1.0
WHEELBASE = Vehicle().wheelbase
TURN = SPEED * PERIOD_S / WHEELBASE  # of the heading in a period, by 1 rad of steering
A = np.array([[1.0, SPEED * PERIOD_S], [0.0, 1.0]])
B = np.array([[0.5 * SPEED * PERIOD_S * TURN], [TURN]])
STATE_COST = np.diag([20.0, 5.0])
INPUT_COST = np.array([20.0])
GAIN = feedback_gains(A[None], B[None], STATE_COST, INPUT_COST)[0]
print("feedback of y, theta:", GAIN[0].round(3))
print("poles:", np.linalg.eigvals(A + B @ GAIN).round(3))


class Feedback:
    """Steer the tractor by the gain; trailer and speed follow the reference."""

    def __init__(self, vehicle, reference, period_s):
        self.grid = reference.on_grid(period_s)
        self.states = []
        self.inputs = []

    def step(self, estimate, k):
        k = min(k, len(self.grid.time_s) - 1)
        delta_t, delta_i, hp = self.grid.inputs[k]
        x, y, yaw = estimate.state[:3] - self.grid.state[k, :3]
        state = np.array([y, math.remainder(yaw, math.tau)])
        steering = float((GAIN @ state)[0])
        self.states.append(state)
        self.inputs.append(steering)
        return Command(delta_t + steering, delta_i, hp - 0.3 * x)


def residuals(field, seed):
    """Drive 34 m straight on a field; return states (n, 2) and residuals (n - 1, 2) from 5 s on."""
    driven = []

    def factory(vehicle, reference, period_s):
        driven.append(Feedback(vehicle, reference, period_s))
        return driven[-1]

    name, scenario = load(field, ["path={kind='straight', length_m=34}"])
    simulate(name, scenario, seed=seed, factory=factory)
    states = np.array(driven[-1].states)[25:]
    inputs = np.array(driven[-1].inputs)[25:, None]
    return states, states[1:] - states[:-1] @ A.T - inputs[:-1] @ B.T


# %% [markdown]
# ## 2. Measure what the model does not know
#
# Four drives on bumpy grass. Each residual is small; what matters is how many of one sign follow
# each other. `fit_set` bounds the energy of every window of ten steps along two axes that are not
# correlated: noise that changes its sign has far less of it than ten times its worst step.

# %%
measured = [residuals("grass", seed)[1] for seed in (11, 12, 13, 14)]
together = np.concatenate(measured)
print("sd of the residuals:", together.std(axis=0).round(4), "m, rad")
disturbance = fit_set(measured, coverage=0.99, window=10)

# %% [markdown]
# ## 3. The tube
#
# With $u = \bar u + K (x - \bar x)$ the deviation $m = x - \bar x$ from a plan $\bar x$ moves by
# itself: $m_{k+1} = (A + BK)\, m_k + w_k$. All deviations that disturbances in $W$ can reach, from
# the first step to the last, are the set
#
# $$S = W \oplus (A + BK) W \oplus (A + BK)^2 W \oplus \cdots$$
#
# `invariant_tube` computes a set around it that is at most a little larger, with a bound on how
# much (Rakovic et al. 2005).

# %%
system = TrackingSystem.along(A[None], B[None], GAIN[None])
tube = invariant_tube(system, disturbance)
half_y, half_theta = tube.states[0]
half_steering = float(tube.inputs[0][0])
print(f"tube: {100 * half_y:.1f} cm, {math.degrees(half_theta):.1f} deg")
print(f"steering that the feedback needs in it: {math.degrees(half_steering):.1f} deg")

shape = outline(tube.at(0), np.eye(2))
figure, axes = plt.subplots(figsize=(5.5, 3.6), layout="constrained")
axes.fill(100.0 * shape[:, 0], np.degrees(shape[:, 1]), color="0.9", label="tube of grass")
inside = {}
for field, colour, marker in (("grass", "tab:blue", "."), ("wet-slope", "tab:orange", "x")):
    states, _ = residuals(field, seed=21)
    axes.plot(100.0 * states[:, 0], np.degrees(states[:, 1]), marker, color=colour, label=field)
    inside[field] = np.mean(np.abs(states[:, 0]) <= half_y)
axes.set(xlabel="y [cm]", ylabel="heading error [deg]")
axes.legend()
for field, share in inside.items():
    print(f"{field}, a fresh seed: |y| within the tube in {100 * share:.0f} % of the ticks")

# %% [markdown]
# On the field that the residuals were measured on, a fresh drive stays in. On the wet slope the
# vehicle is outside a third of the time: residuals there do not lie in $W$. **The theorem is true
# on both fields. Its premise is not.** Whoever quotes a tube has to say where its set was
# measured.
#
# ## 4. A plan that leaves room
#
# A crop row stands 20 cm to the left, and a hoe works the better the nearer it comes. An MPC that
# believes its model plans right up to the row; any bump then puts the hoe into the crop. The tube
# MPC plans for $\bar x$ and keeps it away by what the tube needs (Mayne, Seron and Rakovic 2005):
#
# $$\bar y_j \le 0.20 - \max_{m \in S} m_y, \qquad |\bar u_j| \le u_{max} - \max_{m \in S} |K m| .$$

# %%
ROW_M = 0.20  # also the target
STEERING = math.radians(35.0)
HORIZON = 20


def planned(state, most_y, most_steering):
    """Return the states (N + 1, 2) and inputs (N,) of a plan from a state.

    The QP over inputs and states minimises the distance to the row, heading and steering. y is at
    most `most_y`; where that cannot be kept, each metre above it costs 1000.
    """
    n = 2 * HORIZON
    size = 2 * n  # states 1 to N (2 each), inputs (N), slacks (N)
    cost = np.zeros((size, size))
    gradient = np.zeros(size)
    equal = np.zeros((n, size))
    start = np.zeros(n)
    start[:2] = -A @ state
    below = np.zeros((HORIZON, size))
    for j in range(HORIZON):
        now = slice(2 * j, 2 * j + 2)
        cost[now, now] = STATE_COST
        gradient[2 * j] = -STATE_COST[0, 0] * ROW_M
        cost[n + j, n + j] = INPUT_COST[0]
        if j:
            equal[now, 2 * j - 2 : 2 * j] = A
        equal[now, now] = -np.eye(2)
        equal[now, n + j] = B[:, 0]
        below[j, 2 * j] = 1.0
        below[j, n + HORIZON + j] = -1.0
    gradient[n + HORIZON :] = 1000.0
    lower = np.full(size, -np.inf)
    lower[n : n + HORIZON] = -most_steering
    lower[n + HORIZON :] = 0.0
    upper = np.full(size, np.inf)
    upper[n : n + HORIZON] = most_steering
    solver = piqp.DenseSolver()
    solver.setup(cost, gradient, equal, start, below, None, np.full(HORIZON, most_y), lower, upper)
    if solver.solve() != piqp.PIQP_SOLVED:
        raise RuntimeError("the QP was not solved")
    states = np.vstack([state, solver.result.x[:n].reshape(HORIZON, 2)])
    return states, solver.result.x[n : n + HORIZON]


def kept(tightened, disturbances):
    """Drive the model under measured residuals; return y (n,)."""
    state = np.zeros(2)
    plan = np.zeros(2)
    room_y = half_y if tightened else 0.0
    room_steering = half_steering if tightened else 0.0
    offsets = []
    for w in disturbances:
        start = plan if tightened else state
        states, inputs = planned(start, ROW_M - room_y, STEERING - room_steering)
        steering = inputs[0] + float((GAIN @ (state - states[0]))[0])
        state = A @ state + B[:, 0] * np.clip(steering, -STEERING, STEERING) + w
        plan = states[1]
        offsets.append(state[0])
    return np.array(offsets)


_, fresh = residuals("grass", seed=31)
figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
axes.set(xlabel="time [s]", ylabel="y [cm]")
axes.axhline(100.0 * ROW_M, color="tab:green", label="crop row")
for label, tightened in (("believes its model", False), ("with the tube", True)):
    offsets = kept(tightened, fresh)
    axes.plot(PERIOD_S * np.arange(len(offsets)), 100.0 * offsets, label=label)
    settled = offsets[50:]
    beyond = np.mean(settled > ROW_M)
    distance_cm = 100.0 * (ROW_M - settled.mean())
    share = f"in the row {100 * beyond:.0f} % of the time"
    print(f"{label}: {share}, mean distance {distance_cm:.1f} cm")
    axes.legend()

# %% [markdown]
# The tube's plan gives up room for safety. That is the price, and it is paid on every metre, bump
# or not. `ttempc` tightens with a tube that grows over the horizon from nothing, and pays less
# ([tubes](../tube.md)).
#
# ## Exercises
#
# 1. Refit $W$ on residuals of `wet-slope`. How wide is its tube? Is the corridor still possible?
#    What would you change first: the set, the gain, or the model?
# 2. The residuals on the slope have a mean. Subtract it, as a filter that estimates slip would,
#    and compare.
# 3. Windows of 1, 10 and 40 steps in `fit_set`: how does the tube change, and why? Which
#    assumption about the residuals do you make by each?
# 4. Choose a stiffer gain (`INPUT_COST` of 2). The tube becomes narrower and needs more steering.
#    Where is the best trade for a limit of 5 deg?
