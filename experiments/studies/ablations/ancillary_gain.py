"""Ancillary gains of the growing tube: what each takes of the inputs, and how wide its tube is.

    python -m experiments.studies.ablations.ancillary_gain

Along the figure eight of `grass` with the shipped tube: the design's gain, the same without the
hydrostat, that of `ttempc`, and none. Shares are of the change in a period, at the largest;
half widths [m] those of the last stage of the horizon, at the largest.
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from ttempc.laws.articulated_mpc import MpcOptions
from ttempc.mpc.articulated_error import error_dynamics
from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import reachable_inputs, steered_system, tracking_system
from ttempc.tube.tube import reach_backwards
from ttempc.types import Input
from ttempc.vehicle import CommandLimits

from ...scenario.tube_file import read_tube

TICKS = 680  # one lap


def main() -> None:
    """Print the Markdown table of docs/tube.md."""
    design, horizon = read_tube("grass").design(), MpcOptions().horizon
    limits = CommandLimits.of(design.vehicle, design.period_s)
    reference = Reference(figure_eight(laps=1), design.vehicle, ConstantSpeed(1.0))
    matrices = error_dynamics(reference, design.period_s, TICKS)
    full = tracking_system(*matrices, design.weights)
    no_hydrostat = full.gains.copy()
    no_hydrostat[:, Input.HP] = 0.0
    systems = {
        "of the design": full,
        "without the hydrostat": replace(full, gains=no_hydrostat),
        "of `ttempc`": steered_system(design, *matrices, limits, horizon)[0],
        "none": replace(full, gains=np.zeros_like(full.gains)),
    }
    print("| gain | front | trailer | hydrostat | tractor across, along | trailer across, along |")
    print("|---|---|---|---|---|---|")
    for label, system in systems.items():
        _, rates = reachable_inputs(system, design.disturbance, horizon)
        shares = rates.max(axis=(0, 1)) / limits.step
        backwards = reach_backwards(system, design.disturbance, np.arange(TICKS), system.c)
        completed, energy, _ = next(itertools.islice(backwards, horizon - 2, None))
        x_t, y_t, x_i, y_i = (completed + design.disturbance.reach(energy)).max(axis=0)
        cells = " | ".join(f"{share:.2f}" for share in shares)
        print(f"| {label} | {cells} | {y_t:.2f}, {x_t:.2f} | {y_i:.2f}, {x_i:.2f} |")


if __name__ == "__main__":
    main()
