"""Records of runs that never took place, made so that their errors are known in closed form."""

import math

import numpy as np
from proving_ground.testbed.recording.channels import (
    CHANNELS,
    CONTROL,
    CORRIDOR,
    ESTIMATE,
    REFERENCE,
    STATE,
    TIMING,
    TOOL,
    TUBE,
    TYRES,
)
from proving_ground.testbed.recording.record import Record, Table

PERIOD_S = 0.04
TRAILER_BEHIND_M = 2.4
RADIUS_M = 10.0


def straight(s):
    """Curvature of a straight path."""
    return np.zeros_like(s)


def circle(s):
    """Curvature of a circle to the left."""
    return np.full_like(s, 1.0 / RADIUS_M)


def eight(s):
    """Curvature of a figure eight: straights of 22.4 m, arcs, blends of 2 m between them."""
    arc, line = 45.95, 22.4
    at = np.mod(s, 2 * (arc + line))
    first = np.interp(at, [line, line + 2, line + arc - 2, line + arc], [0, 1, 1, 0], 0, 0)
    second = np.interp(
        at, [2 * line + arc, 2 * line + arc + 2, 2 * (line + arc) - 2], [0, 1, 1], 0, 0
    )
    return (first - second) / RADIUS_M


def record(
    curvature=eight,
    duration_s=60.0,
    *,
    along=(0.0, 0.0),
    cross=(0.0, 0.0),
    estimate_off=(0.0, 0.0),
    noise_m=0.0,
    turned=0.0,
    moved=(0.0, 0.0),
    mirrored=False,
    tool=None,
    events=(),
) -> Record:
    """Return a run at 1 m/s whose tractor and trailer keep constant errors (tractor, trailer).

    The map may be turned, then moved; `mirrored` reflects everything at the x axis. With `tool`
    (along, cross) there is an implement, lowered in the first half.
    """
    rng = np.random.default_rng(1)
    t = PERIOD_S * np.arange(round(duration_s / PERIOD_S) + 1)
    s = np.arange(-TRAILER_BEHIND_M, duration_s + 1e-9, 1e-3)
    heading = np.cumsum(curvature(s)) * 1e-3
    x, y = np.cumsum(np.cos(heading)) * 1e-3, np.cumsum(np.sin(heading)) * 1e-3
    cos, sin = math.cos(turned), math.sin(turned)
    sign = -1.0 if mirrored else 1.0
    reference, state, estimate = ({} for _ in range(3))
    for body, (letter, lag) in enumerate((("t", 0.0), ("i", TRAILER_BEHIND_M))):
        psi = np.interp(t - lag, s, heading)
        px, py = np.interp(t - lag, s, x), np.interp(t - lag, s, y)
        a = along[body] + noise_m * rng.normal(size=len(t))
        c = cross[body] + noise_m * rng.normal(size=len(t))
        qx = px + a * np.cos(psi) - c * np.sin(psi)
        qy = py + a * np.sin(psi) + c * np.cos(psi)
        for into, (u, v) in (
            (reference, (px, py)),
            (state, (qx, qy)),
            (estimate, (qx + estimate_off[body], qy)),
        ):
            v = sign * v
            into[f"x_{letter}_m"] = cos * u - sin * v + moved[0]
            into[f"y_{letter}_m"] = sin * u + cos * v + moved[1]
            into[f"psi_{letter}_rad"] = sign * psi + turned
    reference |= {"curvature_per_m": sign * curvature(t), "v_mps": np.ones_like(t)}
    ticks = slice(None, None, 5)
    given = {
        STATE: (t, state),
        REFERENCE: (t, reference),
        ESTIMATE: (t[ticks], {name: column[ticks] for name, column in estimate.items()}),
        CONTROL: (t[ticks], _control(t[ticks], curvature(t[ticks]), rng)),
        TIMING: (
            t[ticks],
            {name: rng.lognormal(4.0, 0.3, len(t[ticks])) for name in TIMING.fields},
        ),
        TYRES: (t, _tyres(t, rng)),
        TUBE: (t[:0], {}),  # kept to by few controllers
        CORRIDOR: (t[:0], {}),  # of few fields
        TOOL: _tool(t, reference, tool) if tool else (t[:0], {}),
    }
    return Record(
        {
            channel.topic: table_of(channel, *given.get(channel, (t[ticks], {})))
            for channel in CHANNELS
        },
        events,
        {"scenario": "made up"},
    )


def table_of(channel, time_s, columns) -> Table:
    """Return a table with the given columns, NaN in all others."""
    missing = np.full(len(time_s), np.nan)
    return Table(
        channel,
        np.asarray(time_s, dtype=float),
        np.column_stack([columns.get(name, missing) for name in channel.fields]),
    )


def _control(t, curvature, rng):
    columns = {}
    for name, gain, low, high in (
        ("delta_t_rad", 1.4, -0.61, 0.61),
        ("delta_i_rad", 2.7, -0.44, 0.44),
        ("hp", 0.0, 0.0, 1.0),
    ):
        feedforward = gain * curvature + (0.714 if name == "hp" else 0.0)
        feedback = 0.03 * rng.normal(size=len(t))
        robust = 0.05 * np.sin(0.5 * t)
        total = feedforward + feedback + robust
        columns |= {
            f"{name}_feedforward": feedforward,
            f"{name}_feedback": feedback,
            f"{name}_robust": robust,
            f"{name}_total": total,
            f"{name}_command": np.clip(total, low, high),
            f"{name}_min": np.full(len(t), low),
            f"{name}_max": np.full(len(t), high),
            f"{name}_limited": (np.clip(total, low, high) != total).astype(float),
        }
    return columns


def _tool(t, reference, error):
    """Return rows of a tool half a metre behind the trailer point, with a constant error."""
    cos, sin = np.cos(reference["psi_i_rad"]), np.sin(reference["psi_i_rad"])
    x, y = reference["x_i_m"] - 0.5 * cos, reference["y_i_m"] - 0.5 * sin
    lowered = t < 0.5 * t[-1]
    along, cross = (np.where(lowered, each, 9.0) for each in error)
    return t, {
        "x_m": x + along * cos - cross * sin,
        "y_m": y + along * sin + cross * cos,
        "x_reference_m": x,
        "y_reference_m": y,
        "depth_m": np.where(lowered, 0.05, 0.0),
        "draft_n": np.where(lowered, 900.0 + t, 0.0),
        "side_n": np.where(lowered, -50.0, 0.0),
        "lowered": lowered.astype(float),
    }


def _tyres(t, rng):
    columns = {}
    for axle, load in (("front", 1300.0), ("rear", 2400.0), ("trailer", 2400.0)):
        for side, tilt in (("left", 1.0), ("right", -1.0)):
            wheel = f"{axle}_{side}"
            columns |= {
                f"{wheel}_load_n": load * (1 + 0.1 * tilt + 0.05 * rng.normal(size=len(t))),
                f"{wheel}_slip": 0.06 + 0.02 * rng.normal(size=len(t)),
                f"{wheel}_slip_angle_rad": 0.02 * tilt + 0.01 * rng.normal(size=len(t)),
            }
    return columns
