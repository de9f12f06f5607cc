"""Numerics of the simulation: time step, repeatability, comparison of wheel models."""

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
    """Check the end point after 10 s on the scenario's ground at four time steps."""
    ends = []
    for timestep in _TIMESTEPS_S:
        plant = bench.scenario_plant(timestep_s=timestep)
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
            figure=1e3 * apart.max(),
            low=0.0,
            high=20.0,
            unit="mm",
            source="convergence; 20 mm assumed, below the GNSS noise of the paper (30 mm)",
            note=f"from that at 0.5 ms: {text}",
        )
    ]


def same_bits(bench: Bench) -> list[Check]:
    """Check that the same drive ends in the same bits, in two plants and from a snapshot."""
    command = bench.command(SPEED, 0.2, -0.1)

    def driven() -> Plant:
        plant = bench.scenario_plant()
        plant.reset(*_start(bench), SPEED)
        plant.advance(command, steps(plant, _BITS_S))
        return plant

    one, other = driven(), driven()
    snapshot = one.snapshot()
    one.advance(command, 200)
    first = state_hash(one)
    one.restore(snapshot)
    one.advance(command, 200)
    other.advance(command, 200)
    differing = (state_hash(other) != first) + (state_hash(one) != first)
    return [
        between(
            "drives that end in other bits, of 2 repeated",
            figure=differing,
            low=0.0,
            high=0.0,
            unit="",
            source="same input, same state: bit for bit",
        )
    ]


def wheel_models(bench: Bench) -> list[Check]:
    """Check that soil wheels and contact wheels agree on firm level ground."""
    ends = []
    for wheels in ("soil", "contact"):
        plant = bench.plant(wheels=wheels)
        stand = plant.reset(-10.0, 0.0, 0.0, 0.0).wheels.load
        plant.reset(-10.0, 0.0, 0.0, SPEED)
        truth = plant.advance(bench.command(SPEED, 0.1), steps(plant, _AGREE_S))
        ends.append((truth, stand))
    (soil, soil_load), (contact, contact_load) = ends
    apart = math.hypot(contact.tractor.x - soil.tractor.x, contact.tractor.y - soil.tractor.y)
    source = "two wheel models of one vehicle on firm ground"
    return [
        between(
            "speed, soil wheels against contact wheels",
            figure=100.0 * abs(contact.speed / soil.speed - 1.0),
            low=0.0,
            high=4.0,
            unit="%",
            source=source,
        ),
        between(
            "end point of 10 m in a gentle turn, soil wheels against contact wheels",
            figure=100.0 * apart / (SPEED * _AGREE_S),
            low=0.0,
            high=3.0,
            unit="% of the way",
            source=source,
        ),
        between(
            "static wheel loads, soil wheels against contact wheels",
            figure=100.0 * float(np.abs(contact_load - soil_load).max() / soil_load.sum()),
            low=0.0,
            high=2.0,
            unit="% of the weight",
            source=source,
        ),
    ]


def state_hash(plant: Plant) -> str:
    """Return a hash of the plant's state without the last report of its wheels."""
    snapshot = plant.snapshot()
    return hashlib.sha256(snapshot.physics.tobytes() + snapshot.wheel_state.tobytes()).hexdigest()


def _start(bench: Bench) -> tuple[float, float, float]:
    """Return a start (x, y, yaw) with 10 m of field ahead."""
    x, y = bench.terrain.centre
    return x - 0.5 * SPEED * _CONVERGE_S, y, 0.0
