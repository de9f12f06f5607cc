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
# # Lecture 1: linear MPC, from the model to the field
#
# Forty-five minutes. You write the model of a tractor with a steerable trailer, make a linear MPC
# of it, drive that first on the model itself and then on soil that slips, and turn its knobs. Each
# cell runs by itself, without a network; the lecture as a whole takes about half a minute.
#
# You need: linear algebra, state-space models, what a quadratic programme is.

# %%
import math

import matplotlib.pyplot as plt
import numpy as np
import piqp

from proving_ground import load, simulate
from ttempc import Command, Vehicle

# %% [markdown]
# ## 1. The model
#
# Three bodies: the tractor with yaw $\psi_t$, the drawbar, the trailer with yaw $\psi_i$. The
# front wheels steer by $\delta_t$, a cylinder turns the drawbar against the trailer by $\delta_i$.
# Where no wheel slips aside, geometry alone says how the bodies turn:
#
# $$\dot\psi_t = \frac{v \tan\delta_t}{L_t}, \qquad
# \dot\psi_i = \frac{v \sin\lambda - a \dot\psi_t \cos\lambda
# - d \dot\delta_i \cos\delta_i}{L_i + d \cos\delta_i},
# \qquad \lambda = \psi_t - \psi_i .$$
#
# Valves and hydrostat are lags of first order. The state is $(x, y, \psi_t, \psi_i, \delta_t,
# \delta_i, v)$, the input the two commanded angles and the hydrostat's position.

# %%
vehicle = Vehicle()


def state_rate(state, command):
    """Return the time derivative (7,) of a state under a command (3,)."""
    psi_t, psi_i, delta_t, delta_i, v = state[2:]
    delta_t_rate = (command[0] - delta_t) / vehicle.steering_lag_t
    delta_i_rate = (command[1] - delta_i) / vehicle.steering_lag_i
    v_rate = (vehicle.speed_gain * command[2] - v) / vehicle.speed_time_constant

    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    angle = psi_t - psi_i
    psi_t_rate = v * math.tan(delta_t) / vehicle.wheelbase
    pushed = v * math.sin(angle) - a * psi_t_rate * math.cos(angle)
    pushed -= d * delta_i_rate * math.cos(delta_i)
    psi_i_rate = pushed / (vehicle.trailer_length + d * math.cos(delta_i))
    return np.array(
        [
            v * math.cos(psi_t),
            v * math.sin(psi_t),
            psi_t_rate,
            psi_i_rate,
            delta_t_rate,
            delta_i_rate,
            v_rate,
        ]
    )


def trailer_point(state):
    """Return the centre of the trailer's axle, (2,)."""
    x, y, psi_t, psi_i, _, delta_i, _ = state
    psi_d = psi_i + delta_i
    a = vehicle.hitch_offset
    d = vehicle.drawbar_length
    length = vehicle.trailer_length
    return np.array(
        [
            x - a * math.cos(psi_t) - d * math.cos(psi_d) - length * math.cos(psi_i),
            y - a * math.sin(psi_t) - d * math.sin(psi_d) - length * math.sin(psi_i),
        ]
    )


# %% [markdown]
# ## 2. Errors across the path
#
# The reference is a trajectory of the same model: a state and a command for each control tick.
# What matters is how far the two axle points are to the side of theirs, and how far the tractor is
# behind. These three outputs are measured in the frame of the reference, to the left positive.


# %%
def outputs(state, reference):
    """Return how far the tractor is ahead and left of its reference, and the trailer left (3,)."""
    psi_t = reference[2]
    psi_i = reference[3]
    off = state[:2] - reference[:2]
    trailer_off = trailer_point(state) - trailer_point(reference)
    return np.array(
        [
            off[0] * math.cos(psi_t) + off[1] * math.sin(psi_t),
            off[1] * math.cos(psi_t) - off[0] * math.sin(psi_t),
            trailer_off[1] * math.cos(psi_i) - trailer_off[0] * math.sin(psi_i),
        ]
    )


# %% [markdown]
# ## 3. Linearise and discretise
#
# Near the reference the model is linear in the errors, $z = $ state less reference and $u = $
# command less reference:
#
# $$z_{k+1} = A_k z_k + B_k u_k, \qquad y_k = C_k z_k .$$
#
# The derivatives are taken by central differences of one Runge-Kutta step. That needs no algebra,
# and it is how you check the algebra once you have done it.


# %%
def stepped(state, command, period_s):
    """Return the state after a period, by a Runge-Kutta step of fourth order."""
    k_1 = state_rate(state, command)
    k_2 = state_rate(state + 0.5 * period_s * k_1, command)
    k_3 = state_rate(state + 0.5 * period_s * k_2, command)
    k_4 = state_rate(state + period_s * k_3, command)
    return state + period_s / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)


def jacobian(function, at):
    """Return the derivative of a function of one vector, by central differences."""
    size = 1e-5
    columns = [(function(at + h) - function(at - h)) / (2.0 * size) for h in size * np.eye(len(at))]
    return np.array(columns).T


def linearised(state, command, period_s):
    """Return A (7, 7), B (7, 3) and C (3, 7) at a state and a command."""
    a = jacobian(lambda z: stepped(z, command, period_s), state)
    b = jacobian(lambda u: stepped(state, u, period_s), command)
    c = jacobian(lambda z: outputs(z, state), state)
    return a, b, c


# %% [markdown]
# ## 4. The quadratic programme
#
# Over a horizon of $N$ steps the MPC minimises
#
# $$\sum_{j=1}^{N} y_j^\top Q\, y_j + \sum_{j=0}^{N-1} (u_j - u_{j-1})^\top R\, (u_j - u_{j-1})$$
#
# with bounds on the commands. The errors $z_1, \ldots, z_N$ follow from $z_0$ and the inputs, so
# that the inputs alone are variables: the *condensed* form. PIQP solves it. The command is the
# reference's less nothing, plus the first input.


# %%
class LinearMpc:
    """Linear MPC of the tracking errors, condensed along the reference."""

    def __init__(
        self,
        vehicle,
        reference,
        period_s,
        horizon=12,
        output_weight=(1.0, 2.5, 2.5),
        step_weight=(0.15, 0.1, 0.15),
    ):
        grid = reference.on_grid(period_s)
        self.states = grid.state
        self.commands = grid.inputs
        self.horizon = horizon
        self.output_weight = np.diag(output_weight)
        self.step_weight = np.diag(step_weight)
        self.least = vehicle.input_min
        self.most = vehicle.input_max
        self.input = np.zeros(3)
        self.models = [
            linearised(state, command, period_s)
            for state, command in zip(self.states, self.commands, strict=True)
        ]

    def programme(self, k, error):
        """Return Hessian and gradient of the cost over the inputs of a horizon (3 N,)."""
        n = 3 * self.horizon
        hessian = np.zeros((n, n))
        gradient = np.zeros(n)
        free = error  # the error j steps ahead without any input
        by_inputs = np.zeros((7, n))  # how the inputs change it
        for j in range(self.horizon):
            at = min(k + j, len(self.models) - 1)
            a, b, _ = self.models[at]
            c = self.models[min(at + 1, len(self.models) - 1)][2]
            free = a @ free
            by_inputs = a @ by_inputs
            by_inputs[:, 3 * j : 3 * j + 3] += b
            seen = c @ by_inputs
            hessian += seen.T @ self.output_weight @ seen
            gradient += seen.T @ self.output_weight @ (c @ free)

        # Changes from one input to the next; before the first one is that of the tick before
        changes = np.eye(n) - np.eye(n, k=-3)
        weights = np.kron(np.eye(self.horizon), self.step_weight)
        hessian += changes.T @ weights @ changes
        gradient[:3] -= self.step_weight @ self.input
        return 2.0 * hessian, 2.0 * gradient

    def step(self, estimate, k):
        """Return the command of a control tick."""
        k = min(k, len(self.states) - 1)
        error = estimate.state - self.states[k]
        error[2:4] = np.remainder(error[2:4] + np.pi, 2.0 * np.pi) - np.pi
        hessian, gradient = self.programme(k, error)
        ahead = np.minimum(np.arange(k, k + self.horizon), len(self.commands) - 1)
        upper = (self.most - self.commands[ahead]).ravel()
        lower = (self.least - self.commands[ahead]).ravel()

        solver = piqp.DenseSolver()
        solver.setup(hessian, gradient, x_l=lower, x_u=upper)
        if solver.solve() != piqp.PIQP_SOLVED:
            return Command(*self.commands[k])
        self.input = solver.result.x[:3].copy()
        return Command(*(self.commands[k] + self.input))


# %% [markdown]
# ## 5. The loop closed on the model
#
# First on the model itself, from half a metre beside the path. Here nothing can go wrong but the
# law: a sign, a unit, an index.

# %%
name, scenario = load("grass", ["path={kind='headland', passes=2, length_m=10}"])
made = {}


def keep_reference(vehicle, reference, period_s):
    """Make the MPC, and keep it: it has the reference of the scenario."""
    made["mpc"] = LinearMpc(vehicle, reference, period_s)
    return made["mpc"]


summary, _ = simulate(name, scenario, seed=1, factory=keep_reference)
print(f"on {name}: {summary.status}")


class Seen:
    """An estimate that is the state itself."""

    def __init__(self, state):
        self.state = state


def closed_loop(mpc, start_error, ticks):
    """Drive the model; return its outputs (ticks, 3)."""
    mpc.input = np.zeros(3)
    state = mpc.states[0] + start_error
    rows = []
    for k in range(ticks):
        rows.append(outputs(state, mpc.states[k]))
        command = mpc.step(Seen(state), k)
        state = stepped(state, command.as_array(), 0.2)
    return np.array(rows)


beside = np.array([0.0, 0.5, 0.0, 0.0, 0.0, 0.0, 0.0])
rows = closed_loop(made["mpc"], beside, 100)
time_s = 0.2 * np.arange(len(rows))
figure, axes = plt.subplots(figsize=(7, 2.6), layout="constrained")
axes.plot(time_s, 100.0 * rows[:, 1], label="tractor")
axes.plot(time_s, 100.0 * rows[:, 2], "--", label="trailer")
axes.set(xlabel="time [s]", ylabel="cross-track error [cm]")
axes.legend()
print(f"after 20 s: {100 * np.abs(rows[-1, 1:]).max():.2f} cm")

# %% [markdown]
# ## 6. On the field
#
# Now the same law on soil: tyres that slip, a slope, hydraulics with limits, receivers with 3 cm
# of noise, a filter in between. The model of section 1 holds nowhere. `ttempc` drives the same
# field under the same seed.


# %%
def drive(field, factory, options=None):
    """Return p95 of the cross-track errors of tractor and trailer [cm]; NaN if it was lost."""
    name, scenario = load(field, ["path={kind='headland', passes=2, length_m=10}"])
    summary, _ = simulate(name, scenario, seed=1, factory=factory, options=options or {})
    errors = summary.tracking.all
    if summary.status != "completed":
        return math.nan, math.nan
    return 100.0 * errors.tractor.cross_p95_m, 100.0 * errors.trailer.cross_p95_m


print("p95 of tractor, trailer [cm]".ljust(30), "grass".rjust(12), "wet-slope".rjust(12))
for label, factory in (("this lecture", LinearMpc), ("ttempc", None)):
    values = [drive(field, factory) for field in ("grass", "wet-slope")]
    print(label.ljust(30), *(f"{tractor:6.1f},{trailer:5.1f}" for tractor, trailer in values))

# %% [markdown]
# On grass sixty lines are as good as `ttempc`. On the slope the law of this lecture drives beside
# its path: both axles slip downhill all the time, and nothing in it knows. A linear MPC without a
# disturbance in its model has no integral action. `ttempc` gets the slips from the filter and moves
# its target by what they will do ([method](../method.md#linear-mpc)); [lecture 2](estimation.py)
# builds the filter that tells them.
#
# ## 7. Knobs

# %%
print("[cm] on grass".ljust(30), "tractor, trailer")
for label, options in (
    ("as above", {}),
    ("horizon 3 steps, 0.6 s", {"horizon": 3}),
    ("horizon 20 steps, 4 s", {"horizon": 20}),
    ("trailer does not count", {"output_weight": [1.0, 2.5, 0.0]}),
    ("changes cost 20 times more", {"step_weight": [3.0, 2.0, 3.0]}),
):
    tractor, trailer = drive("grass", LinearMpc, options)
    print(label.ljust(30), f"{tractor:7.1f}, {trailer:7.1f}")

# %% [markdown]
# ## Exercises
#
# 1. Why does a horizon of 0.6 s fail or weave? Relate it to the distance in which a side step of
#    the tractor reaches the trailer.
# 2. Add a constant side slip to `state_rate` and to the prediction, give it the value of
#    `estimate.disturbance[0]`, and drive `wet-slope` again. What remains, and why?
# 3. Bounds: set `self.most` and `self.least` to a third. In how many ticks does PIQP find a bound
#    active? What does the horizon then do for you that a gain of LQR does not?
# 4. Compute the gain of LQR for a straight line from the same $A$, $B$, $Q$, $R$
#    (`scipy.linalg.solve_discrete_are`) and compare it with the first input of the unconstrained
#    programme. From which horizon on are they equal to 1 %?
