"""A controller from scratch, driven on the proving ground beside the default.

    python docs/examples/own_controller.py
    ttempc run grass --controller own_controller:Stanley --set controller.options.gain=0.8

Feedforward of the reference, and feedback on the tractor's cross-track and heading error after
Hoffmann et al. 2007, "Autonomous automobile trajectory tracking for off-road driving".
"""

import math

from proving_ground import load, simulate
from ttempc import Command, State


class Stanley:
    """Steers the tractor back to its path; the trailer follows by feedforward."""

    def __init__(self, vehicle, reference, period_s, gain=0.5):
        self.grid = reference.on_grid(period_s)
        self.gain = gain  # [1/s]

    def step(self, estimate, k):
        """Return the command of control tick `k`."""
        k = min(k, len(self.grid.time_s) - 1)
        x, y, yaw = estimate.state[:3]
        x_r, y_r, yaw_r = self.grid.state[k, :3]
        aside = (y - y_r) * math.cos(yaw_r) - (x - x_r) * math.sin(yaw_r)  # [m] to the left
        behind = (x_r - x) * math.cos(yaw_r) + (y_r - y) * math.sin(yaw_r)  # [m]
        heading = math.remainder(yaw_r - yaw, math.tau)
        delta_t, delta_i, hp = self.grid.inputs[k]
        steering = heading - math.atan2(self.gain * aside, self.grid.state[k, State.V])
        return Command(delta_t + steering, delta_i, hp + 0.3 * behind)


if __name__ == "__main__":
    name, scenario = load("grass", ["path.laps=1"])
    for factory in (None, Stanley):
        summary, _ = simulate(name, scenario, seed=7, factory=factory)
        error = summary.tracking.all
        print(
            f"{summary.controller}: {summary.status}, tractor "
            f"{100 * error.tractor.mean_euclidean_m:.1f} cm, trailer "
            f"{100 * error.trailer.mean_euclidean_m:.1f} cm"
        )
