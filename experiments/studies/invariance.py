"""Invariance of the tube under random and worst-case disturbances, on its own model.

    python -m experiments.studies.invariance [TUBE]

91,000 deviations start at zero, at ticks all along the figure eight, and are disturbed over the
memory of the tube. Most disturbances are noise, noise of full size with random sign, and square
waves, each scaled so that its fullest sliding window fills the set. The rest are worst cases for a
direction, drawn at random or along a state, an output or an input. Prints the largest normalised
deviation, and the ratio of both sides of the invariance condition in dense directions. Neither may
exceed 1.
"""

from __future__ import annotations

import sys

import numpy as np

from ttempc.reference.path import figure_eight
from ttempc.reference.reference import ConstantSpeed, Reference
from ttempc.tube.reference_tube import ReferenceTube
from ttempc.tube.sets import DisturbanceSet, directions_in, linear_map, minkowski_sum
from ttempc.tube.tube import Tube
from ttempc.types import FloatArray

from ..scenario.tube_file import read_tube

SEED = 1
RANDOM = 90_000
WORST = 1_000
BATCH = 1_000  # trajectories that end at the same tick
DIRECTIONS = 1_000  # in which the condition is checked at a tick
STRIDE = 20  # ticks between checks of the condition


def noise(
    disturbance: DisturbanceSet, steps: int, kind: int, generator: np.random.Generator
) -> FloatArray:
    """Return admissible disturbance sequences, (`steps`, BATCH, 7).

    Args:
        disturbance: the set; the largest window of each sequence is on its boundary.
        steps: length.
        kind: 0 normal noise, 1 noise of full size, 2 square waves.
        generator: draws them.
    """
    y = generator.standard_normal((steps, BATCH, disturbance.dimension))
    if kind == 1:
        y = np.sign(y)
    elif kind == 2:
        half_period = generator.integers(1, 30, (BATCH, disturbance.dimension))
        y = (-1.0) ** ((np.arange(steps)[:, None, None] // half_period) % 2)
    energy = np.cumsum(y**2, axis=0)
    windows = energy[disturbance.window - 1 :].copy()
    windows[1:] -= energy[: -disturbance.window]
    along = windows.sum(axis=2) if disturbance.shape == "ellipsoid" else windows.max(axis=2)
    return (y / np.sqrt(along.max(axis=0))[:, None]) @ disturbance.axes.T


def bounded_directions(tube: Tube, k: int) -> tuple[FloatArray, FloatArray]:
    """Return the rows of states, outputs and inputs at tick `k`, and their half widths."""
    rows = np.concatenate([np.eye(7), tube.system.c[k], tube.system.gains[k]])
    return rows, np.concatenate([tube.states[k], tube.outputs[k], tube.inputs[k]])


def response(tube: Tube, k: int, runs: FloatArray) -> FloatArray:
    """Return the deviation at tick `k` after disturbances (steps, ..., 7), from zero."""
    m = np.zeros(runs.shape[1:])
    for step, w in enumerate(runs):
        tick = max(0, k - len(runs) + step)
        m = m @ tube.system.closed[tick].T + w
    return m


def main(name: str) -> None:
    """Apply all disturbances and print the largest normalised deviations."""
    generator = np.random.default_rng(SEED)
    design = read_tube(name).design()
    reference = Reference(figure_eight(laps=1), design.vehicle, ConstantSpeed(1.0))
    ticks = int(reference.duration_s / design.period_s)
    tube = ReferenceTube.along(design, reference, ticks).tube
    certificate = tube.certificate
    steps = certificate.terms * certificate.window
    print(f"alpha {certificate.alpha:.4f}, {certificate.terms} windows of {certificate.window}")

    worst = 0.0
    for k in range(certificate.window, ticks, STRIDE):
        directions = directions_in(7, DIRECTIONS, generator) / tube.states[k]
        after = minkowski_sum(
            [
                linear_map(tube.transition(k, certificate.window), tube.at(k - certificate.window)),
                tube.last_window(k),
            ]
        )
        share = after.support(directions) / tube.at(k).support(directions)
        worst = max(worst, float(share.max()))
    print(f"Phi S + V over S, largest in {DIRECTIONS} directions every {STRIDE} ticks: {worst:.6f}")

    for kind, label in enumerate(("noise", "noise of full size", "square waves")):
        largest = 0.0
        for _ in range(RANDOM // BATCH // 3):
            k = int(generator.integers(steps, ticks))
            rows, widths = bounded_directions(tube, k)
            m = response(tube, k, noise(design.disturbance, steps, kind, generator))
            largest = max(largest, float((np.abs(m @ rows.T) / widths).max()))
        print(f"{RANDOM // 3} runs of {label}: largest share of a half width {largest:.4f}")

    largest, least = 0.0, np.inf
    for count in range(WORST):
        k = int(generator.integers(steps, ticks))
        rows, widths = bounded_directions(tube, k)
        choice = count % (len(rows) + 6)
        if choice < len(rows):
            row, width = rows[choice], widths[choice]
        else:
            row = generator.standard_normal(7) / tube.states[k]
            width = float(tube.at(k).support(row[None])[0])
        reached = float(response(tube, k, tube.worst_case(k, row)) @ row) / width
        largest, least = max(largest, reached), min(least, reached)
    print(f"{WORST} worst cases: share {least:.4f} to {largest:.4f}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "grass")
