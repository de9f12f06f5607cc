"""A tube for a planar drone in gusts, from the residuals of flights.

    python docs/examples/planar_drone.py [FIGURE.png]

The drone (x, z, pitch and their rates; thrust and torque per mass and inertia) flies from side to
side along a feasible motion. Its model has still air; in flight a gusty wind drags it. The
residuals of 30 flights give the disturbance set, the linearised motion gives a time-varying tube,
and 200 fresh flights count how often the drone stays inside.
"""

import sys

import numpy as np

from ttempc.tube import (
    TrackingSystem,
    feedback_gains,
    fit_set,
    invariant_tube,
    search_tube,
)

PERIOD_S, TICKS, GRAVITY = 0.1, 100, 9.81
DRAG, PITCH, GUST_MPS, MEMORY_S = 0.3, 0.5, 0.7, 0.5  # [1/s], [1/(m s)], sd of gusts, their memory
STILL = np.zeros(2)
# Of z and pitch, then thrust and torque
LEAST, MOST = np.array([0.0, -0.6, 0.0, -12.0]), np.array([2.0, 0.6, 20.0, 12.0])


def step(state, u, wind=STILL):
    """Return the state (..., 6) a period later, by Heun's method; the model has still air."""

    def rate(s):
        x = u[..., 0] * np.sin(s[..., 2]) + DRAG * (wind[..., 0] - s[..., 3])
        z = u[..., 0] * np.cos(s[..., 2]) - GRAVITY + DRAG * (wind[..., 1] - s[..., 4])
        pitch = u[..., 1] + PITCH * wind[..., 0]
        return np.concatenate([s[..., 3:], np.stack([x, z, pitch], axis=-1)], axis=-1)

    first = rate(state)
    return state + 0.5 * PERIOD_S * (first + rate(state + PERIOD_S * first))


def reference():
    """Return states (T + 1, 6) and inputs (T, 2) of a motion from side to side."""
    pace, swing = 0.5 * np.pi, 0.2  # [rad/s], amplitude of the pitch [rad]
    start = np.array([0.0, 1.0, 0.0, -swing * GRAVITY / pace, 0.0, swing * pace])
    states, inputs = [start], []
    for k in range(TICKS):
        torque = -swing * pace**2 * np.sin(pace * (k + 0.5) * PERIOD_S)
        inputs.append(np.array([GRAVITY / np.cos(states[-1][2]), torque]))
        states.append(step(states[-1], inputs[-1]))
    return np.array(states), np.array(inputs)


def linearised(states, inputs):
    """Return A (T, 6, 6) and B (T, 6, 2) along the motion, by central differences."""
    columns = []
    for change in 1e-5 * np.eye(8):
        ahead = step(states[:-1] + change[:6], inputs + change[6:])
        behind = step(states[:-1] - change[:6], inputs - change[6:])
        columns.append((ahead - behind) / 2e-5)
    return np.stack(columns[:6], axis=-1), np.stack(columns[6:], axis=-1)


def fly(states, inputs, gains, flights, generator):
    """Return the errors (T + 1, flights, 6) of flights in gusts from the reference."""
    error = np.zeros((TICKS + 1, flights, 6))
    keep = np.exp(-PERIOD_S / MEMORY_S)
    wind = GUST_MPS * generator.standard_normal((flights, 2))
    for k in range(TICKS):
        u = inputs[k] + error[k] @ gains[k].T
        error[k + 1] = step(states[k] + error[k], u, wind) - states[k + 1]
        fresh = generator.standard_normal((flights, 2))
        wind = keep * wind + GUST_MPS * np.sqrt(1.0 - keep**2) * fresh
    return error


def residuals(error, a, b, gains):
    """Return w(k) = e(k+1) - (A + B K) e(k) of every flight, (flights, T, 6)."""
    predicted = np.einsum("kij,kfj->fki", a + b @ gains, error[:-1])
    return np.swapaxes(error[1:], 0, 1) - predicted


def main():
    """Print set, tube and count."""
    states, inputs = reference()
    a, b = linearised(states, inputs)
    generator = np.random.default_rng(1)

    def gains_of(weights):
        return feedback_gains(a, b, np.diag(weights[:6]), weights[6:])

    first = np.array([1.0, 1.0, 0.1, 0.1, 0.1, 0.1, 0.01, 0.01])
    gains = gains_of(first)
    flights = residuals(fly(states, inputs, gains, 30, generator), a, b, gains)
    gusts = fit_set(list(flights), coverage=0.99, window=5)
    print("half widths of a step's disturbance", np.abs(gusts.axes).sum(axis=1).round(5))

    # The search looks at two moments of the motion, each as if it went on for ever.
    at = [0, 10]
    outputs = np.tile(np.eye(6), (len(at), 1, 1))

    def system_of(weights):
        parts = [feedback_gains(a[[k]], b[[k]], np.diag(weights[:6]), weights[6:]) for k in at]
        return TrackingSystem(a[at], b[at], outputs, np.concatenate(parts), np.arange(len(at)))

    def cost(tube):  # position, with a price on more than 0.3 rad of pitch or half the torque
        excess = np.maximum(tube.states[:, 2] / 0.3 - 1, 0) + np.maximum(
            tube.inputs[:, 1] / 6 - 1, 0
        )
        return float(tube.states[:, :2].max() + 0.1 * tube.states[:, :2].sum() + 3.0 * excess.sum())

    found = search_tube(system_of, cost, gusts, first, evaluations=50)
    for name, weights in (("first", first), ("searched", found)):
        gains = gains_of(weights)
        tube = invariant_tube(TrackingSystem.along(a, b, gains), gusts)
        x, z, pitch = tube.states[:, :3].max(axis=0)
        print(f"{name} gain: x +-{x:.3f} m, z +-{z:.3f} m, pitch +-{pitch:.3f} rad")
    motion, taken = (
        np.hstack([x[:, 1:3], u]) for x, u in ((states[:-1], inputs), (tube.states, tube.inputs))
    )
    left = np.minimum(MOST - motion, motion - LEAST) - taken
    print("smallest distance of the motion from the tightened limits", left.min(axis=0).round(3))
    error = fly(states, inputs, gains, 200, generator)[:-1]
    inside = np.all(np.abs(error) <= tube.states[:, None], axis=(0, 2))
    share = np.abs(error / tube.states[:, None]).max(axis=(0, 2))
    print(
        f"fresh flights inside the tube: {inside.sum()} of {len(inside)}, "
        f"largest share of a half width {np.median(share):.2f} (median), {share.max():.2f} (most)"
    )
    if len(sys.argv) > 1:
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots()
        times = PERIOD_S * np.arange(TICKS)
        along, half_width = states[:-1, 0], tube.states[:, 0]
        axes.fill_between(times, along - half_width, along + half_width, color="0.85")
        axes.plot(times, states[:-1, :1] + error[:, :20, 0], color="black", linewidth=0.4)
        axes.set(xlabel="time [s]", ylabel="x [m]")
        figure.savefig(sys.argv[1])


if __name__ == "__main__":
    main()
