"""JSON over UDP: one datagram with the samples of a control period, one with its command.

docs/howto/serve.md describes the datagrams. They are objects with the key `type`, in UTF-8; angles
are in radians, counter-clockwise, and numbers keep all their digits.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Final

import numpy as np

from ttempc.reference.reference import Reference
from ttempc.types import Estimate, FloatArray, State

from .link import Received, Refused, RemoteCommand, RunFacts, TickData, Trouble

VERSION: Final = 1
_MOST_BYTES: Final = 1024  # of a datagram of the peer
_MOST_STAGES: Final = 100  # of the reference in a datagram: some 25 kB of the 64 that UDP carries
_MOST_NAME: Final = 60  # characters
_HELLO: Final = {"type", "version", "name", "reference", "estimate"}
_COMMAND: Final = {"type", "tick", "delta_t_rad", "delta_i_rad", "hp"}


class JsonProtocol:
    """Datagrams `hello` and `command` in, `welcome`, `samples` and `end` out."""

    name = "json"
    space_based = False

    def __init__(self) -> None:
        self._facts: RunFacts | None = None
        self._stages = 0  # of the reference that the peer has asked for
        self._estimate = False  # whether it has asked for the estimate
        self.peer_name = ""
        self.ready = False  # until the first hello

    def begin(self, facts: RunFacts) -> None:
        """Keep the facts for the welcome."""
        self._facts = facts

    def receive(self, payload: bytes) -> Received:
        """Return the command, or the welcome as a reply to a hello.

        Raises:
            Refused: too long, no JSON object of the two types, unknown keys, values out of range,
                a command before the hello.
        """
        if len(payload) > _MOST_BYTES:
            raise Refused(
                Trouble.LENGTH, f"a datagram of {len(payload)} bytes, must be {_MOST_BYTES} at most"
            )
        try:
            message: object = json.loads(payload, parse_constant=_no_constant)
        except (ValueError, RecursionError):
            raise Refused(Trouble.CONTENT, f"{payload[:80]!r} is no JSON") from None
        if not isinstance(message, dict) or message.get("type") not in ("hello", "command"):
            raise Refused(Trouble.CONTENT, f"{payload[:80]!r}: `type` must be `hello` or `command`")
        allowed = _HELLO if message["type"] == "hello" else _COMMAND
        unknown = sorted(message.keys() - allowed)
        if unknown:
            raise Refused(
                Trouble.CONTENT,
                f"unknown key {unknown[0]!r}, allowed: {', '.join(sorted(allowed))}",
            )
        if message["type"] == "hello":
            return self._hello(message)
        if not self.ready:
            raise Refused(Trouble.CONTENT, "command before a hello")
        tick = _whole(message, "tick", 2**53)
        delta_t = _number(message, "delta_t_rad")
        if delta_t is None:
            raise Refused(Trouble.CONTENT, "command without `delta_t_rad`")
        return Received(
            RemoteCommand(tick, delta_t, _number(message, "delta_i_rad"), _number(message, "hp"))
        )

    def standing(self) -> Sequence[bytes]:
        """Return nothing: the peer speaks first."""
        return ()

    def period(self, data: TickData) -> Sequence[bytes]:
        """Return the samples of a tick, with estimate and reference where they were asked for."""
        message: dict[str, object] = {
            "type": "samples",
            "tick": data.k,
            "time_s": data.time_s,
            "samples": [
                {"sensor": item.sensor, "time_s": item.time_s, "value": _plain(item.value)}
                for item in data.samples
            ],
        }
        assert self._facts is not None
        if self._estimate:
            message["estimate"] = _estimate(data.estimate)
        if self._stages:
            ticks = np.arange(self._stages, dtype=np.float64) + data.reference_tick
            message["reference"] = _reference(data.reference, ticks * self._facts.period_s)
        return (_encoded(message),)

    def end(self, status: str) -> Sequence[bytes]:
        """Return the last datagram of the run."""
        return (_encoded({"type": "end", "status": status}),)

    def _hello(self, message: Mapping[str, object]) -> Received:
        if message.get("version") != VERSION:
            raise Refused(Trouble.CONTENT, f"hello: `version` must be {VERSION}")
        name = message.get("name", "")
        if not isinstance(name, str) or len(name) > _MOST_NAME:
            raise Refused(
                Trouble.CONTENT, f"hello: `name` must be text of {_MOST_NAME} letters at most"
            )
        estimate = message.get("estimate", False)
        if not isinstance(estimate, bool):
            raise Refused(Trouble.CONTENT, "hello: `estimate` must be true or false")
        self._stages = _whole(message, "reference", _MOST_STAGES, default=0)
        self._estimate, self.peer_name, self.ready = estimate, name, True
        assert self._facts is not None
        facts = self._facts
        welcome = {
            "type": "welcome",
            "version": VERSION,
            "scenario": facts.scenario,
            "seed": facts.seed,
            "period_s": facts.period_s,
            "ticks": facts.ticks,
            "step": facts.lockstep,
            "vehicle": asdict(facts.vehicle),
        }
        return Received(replies=(_encoded(welcome),))


def _reference(reference: Reference, times_s: FloatArray) -> list[dict[str, float]]:
    sample = reference.at(times_s)
    names = (
        *(
            "x_m",
            "y_m",
            "yaw_rad",
            "trailer_yaw_rad",
            "wheel_rad",
            "trailer_wheel_rad",
            "speed_mps",
        ),
        *("delta_t_rad", "delta_i_rad", "hp"),
        *("trailer_x_m", "trailer_y_m", "curvature_per_m"),
    )
    columns = [*sample.state.T, *sample.inputs.T, *sample.trailer_xy.T, sample.curvature]
    rows = np.column_stack(columns).tolist()
    return [dict(zip(names, row, strict=True)) for row in rows]


def _estimate(estimate: Estimate) -> dict[str, float | None]:
    state = estimate.state
    values = {
        "x_m": state[State.X],
        "y_m": state[State.Y],
        "yaw_rad": state[State.PSI_T],
        "trailer_yaw_rad": state[State.PSI_I],
        "wheel_rad": state[State.DELTA_T],
        "trailer_wheel_rad": state[State.DELTA_I],
        "speed_mps": state[State.V],
        "trailer_x_m": estimate.trailer_xy[0],
        "trailer_y_m": estimate.trailer_xy[1],
        "hitch_rad": estimate.hitch_angle,
    }
    return dict(zip(values, _plain(values.values()), strict=True))


def _plain(values: Iterable[float]) -> list[float | None]:
    """Return numbers as JSON has them: null for one that is not finite."""
    return [float(x) if math.isfinite(x) else None for x in values]


def _encoded(message: Mapping[str, object]) -> bytes:
    return json.dumps(message, allow_nan=False, separators=(",", ":")).encode()


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is no JSON")


def _number(message: Mapping[str, object], key: str) -> float | None:
    """Return a number of a message, None where the key is absent.

    Raises:
        Refused: it is no finite number.
    """
    value = message.get(key)
    if value is None:
        return None
    try:
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
            if math.isfinite(number):
                return number
    except OverflowError:
        pass
    raise Refused(Trouble.CONTENT, f"command: `{key}` must be a finite number")


def _whole(message: Mapping[str, object], key: str, most: int, default: int | None = None) -> int:
    """Return a whole number from 0 to `most` of a message.

    Raises:
        Refused: it is none, or absent without a default.
    """
    value = message.get(key, default)
    if isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= most:
        return value
    raise Refused(Trouble.CONTENT, f"`{key}` must be a whole number from 0 to {most}")
