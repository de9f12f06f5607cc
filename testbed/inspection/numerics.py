"""The simulation itself: time steps, same bits, one wheel model against the other."""

from __future__ import annotations

import hashlib
import math
from typing import Final

import numpy as np

from ..simulation.plant import Plant
from .bench import SPEED, Bench, steps
from .check import Check, between

_TIMESTEPS_S: Final = (0.0005, 0.001, 0.002, 0.004)
_CONVERGE_S: Final = 10.0
_BITS_S: Final = 3.0
_AGREE_S: Final = 10.0


def convergence(bench: Bench) -> list[Check]:
    """End points after 10 s on the scenario's own ground at four time steps."""
    ends = []
    for timestep in _TIMESTEPS_S:
        plant = bench.own(timestep_s=timestep)
        plant.reset(*_start(bench), SPEED)
        truth = plant.advance(bench.command(SPEED, 0.03), steps(plant, _CONVERGE_S))
        ends.append((truth.tractor.x, truth.tractor.y, truth.trailer.x, truth.trailer.y))
    apart = np.abs(np.array(ends) - ends[0]).max(axis=1)
    text = ", ".join(
        f"{1e3 * away:.1f} mm at {1e3 * step:g} ms"
        for away, step in zip(apart[1:], _TIMESTEPS_S[1:], strict=True)
    )
    return [
        between(
            "end point after 10 s, time steps of 0.5 to 4 ms",
            *(1e3 * apart.max(), 0.0, 20.0, "mm"),
            "convergence; 20 mm assumed, below the GNSS noise of the paper (30 mm)",
            note=f"from that at 0.5 ms: {text}",
        )
    ]


def same_bits(bench: Bench) -> list[Check]:
    """The same drive twice, by two plants and from a snapshot."""
    command = bench.command(SPEED, 0.2, -0.1)

    def ridden() -> Plant:
        plant = bench.own()
        plant.reset(*_start(bench), SPEED)
        plant.advance(command, steps(plant, _BITS_S))
        return plant

    one, other = ridden(), ridden()
    snapshot = one.snapshot()
    one.advance(command, 200)
    first = state_hash(one)
    one.restore(snapshot)
    one.advance(command, 200)
    other.advance(command, 200)
    differing = (state_hash(other) != first) + (state_hash(one) != first)
    return [
        between(
            *("drives that end in other bits, of 2 repeated", differing, 0.0, 0.0, ""),
            "same input, same state: bit for bit",
        )
    ]


def wheel_models(bench: Bench) -> list[Check]:
    """Soil wheels and native contact on firm level ground, where both should agree."""
    ends = []
    for wheels in ("soil", "contact"):
        plant = bench.plant(wheels=wheels)
        stand = plant.reset(-10.0, 0.0, 0.0, 0.0).wheels.load
        plant.reset(-10.0, 0.0, 0.0, SPEED)
        truth = plant.advance(bench.command(SPEED, 0.1), steps(plant, _AGREE_S))
        ends.append((truth, stand))
    (soil, load), (native, load_native) = ends
    apart = math.hypot(native.tractor.x - soil.tractor.x, native.tractor.y - soil.tractor.y)
    source = "two models of one vehicle on ground that does not yield"
    return [
        between(
            "speed, soil wheels against native contact",
            *(100.0 * abs(native.speed / soil.speed - 1.0), 0.0, 4.0, "%", source),
        ),
        between(
            "end point of 10 m in a gentle turn, soil wheels against native contact",
            *(100.0 * apart / (SPEED * _AGREE_S), 0.0, 3.0, "% of the way", source),
        ),
        between(
            "static wheel loads, soil wheels against native contact",
            *(100.0 * float(np.abs(load_native - load).max() / load.sum()), 0.0, 2.0),
            *("% of the weight", source),
        ),
    ]


def state_hash(plant: Plant) -> str:
    """Return a hash of everything that the plant's future depends on but its last report."""
    snapshot = plant.snapshot()
    return hashlib.sha256(snapshot.physics.tobytes() + snapshot.wheel_state.tobytes()).hexdigest()


def _start(bench: Bench) -> tuple[float, float, float]:
    """Return a start (x, y, yaw) from which 10 m ahead lie on the field."""
    x, y = bench.terrain.centre
    return x - 0.5 * SPEED * _CONVERGE_S, y, 0.0
