"""JSON over UDP: one datagram with the samples of a control period, one with its command.

docs/integrations.md describes the datagrams. They are objects with the key `type`, in UTF-8; angles
are in radians, counter-clockwise, and numbers keep all their digits.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from ttempc.reference.reference import Reference
from ttempc.types import Estimate, FloatArray

from .link import Received, Refused, RemoteCommand, RunFacts, TickData, WireProtocol

_MOST_BYTES: Final = 1024  # of a datagram of the peer
_MOST_STAGES: Final = 100  # of the reference in a datagram: some 25 kB of the 64 that UDP carries


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)


class _Hello(_Message):
    type: Literal["hello"]
    version: Literal[1]
    name: Annotated[str, Field(max_length=60)] = ""
    reference: Annotated[int, Field(ge=0, le=_MOST_STAGES)] = 0  # stages that are asked for
    estimate: bool = False  # whether it is asked for


class _Command(_Message):
    type: Literal["command"]
    tick: Annotated[int, Field(ge=0, le=2**53)]
    delta_t_rad: float
    delta_i_rad: float | None = None
    hp: float | None = None


class _Resume(_Message):
    type: Literal["resume"]


_RECEIVED: Final[TypeAdapter[_Hello | _Command | _Resume]] = TypeAdapter(
    Annotated[_Hello | _Command | _Resume, Field(discriminator="type")]
)


class JsonProtocol(WireProtocol):
    """Datagrams `hello`, `command` and `resume` in, `welcome`, `samples` and `end` out."""

    name = "json"

    def begin(self, facts: RunFacts, reference: Reference) -> None:
        """Keep the facts for the welcome."""
        self._facts = facts

    def receive(self, payload: bytes, *, known: bool = False) -> Received:
        """Return the command, or the welcome as a reply to a hello.

        Raises:
            Refused: too long, no JSON object of the three types, unknown keys, values out of range,
                one before the hello.
        """
        if len(payload) > _MOST_BYTES:
            raise Refused(f"a datagram of {len(payload)} bytes, must be {_MOST_BYTES} at most")
        try:
            message = _RECEIVED.validate_json(payload)
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            key = ".".join(map(str, first["loc"][1:]))
            what = f"{first['msg']}, got {str(first['input'])[:80]!r}"
            raise Refused(f"`{key}`: {what}" if key else what) from None
        if isinstance(message, _Hello):
            self._asked = message
            self.peer_name = message.name
            self.ready = True
            welcome = {"type": "welcome", "version": message.version, **asdict(self._facts)}
            return Received(replies=(_encoded(welcome),))
        if not known:
            raise Refused(f"{message.type} before a hello")
        if isinstance(message, _Resume):
            return Received(resume=True)
        return Received(
            RemoteCommand(message.tick, message.delta_t_rad, message.delta_i_rad, message.hp)
        )

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
        if self._asked.estimate:
            message["estimate"] = _estimate(data.estimate)
        if self._asked.reference:
            ticks = np.arange(self._asked.reference, dtype=np.float64) + data.reference_tick
            message["reference"] = _reference(data.reference, ticks * self._facts.period_s)
        return (_encoded(message),)

    def end(self, status: str) -> Sequence[bytes]:
        """Return the last datagram of the run."""
        return (_encoded({"type": "end", "status": status}),)


_STATE: Final = (  # in the order of `State`
    *("x_m", "y_m", "yaw_rad", "trailer_yaw_rad"),
    *("wheel_rad", "trailer_wheel_rad", "speed_mps"),
)


def _reference(reference: Reference, times_s: FloatArray) -> list[dict[str, float]]:
    sample = reference.at(times_s)
    names = (
        *_STATE,
        *("delta_t_rad", "delta_i_rad", "hp"),
        *("trailer_x_m", "trailer_y_m", "curvature_per_m"),
    )
    columns = [*sample.state.T, *sample.inputs.T, *sample.trailer_xy.T, sample.curvature]
    rows = np.column_stack(columns).tolist()
    return [dict(zip(names, row, strict=True)) for row in rows]


def _estimate(estimate: Estimate) -> dict[str, float | None]:
    values = (*estimate.state, *estimate.trailer_xy, estimate.hitch_angle)
    names = (*_STATE, "trailer_x_m", "trailer_y_m", "hitch_rad")
    return dict(zip(names, _plain(values), strict=True))


def _plain(values: Iterable[float]) -> list[float | None]:
    """Return numbers as JSON has them: null for one that is not finite."""
    return [float(x) if math.isfinite(x) else None for x in values]


def _encoded(message: Mapping[str, object]) -> bytes:
    return json.dumps(message, allow_nan=False, separators=(",", ":")).encode()
