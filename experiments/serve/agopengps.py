"""AgOpenGPS over UDP: the plant in the place of GNSS receiver and steering module.

docs/howto/serve.md describes the set-up; `agopengps_frames` the bytes and their source.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ttempc.types import Sensor, State

from ...testbed.geodesy import DATUM, Datum
from . import agopengps_frames as frames
from .protocol import Received, RemoteCommand, RunFacts, TickData


class AgOpenGpsProtocol:
    """Positions and steering angles out, steering angles in.

    Position, speed, steering angle and roll are those of the sensors, the heading is that of the
    estimate: the vehicle has no sensor of it. A tick without a sample of GNSS sends no position.
    Steering with the autosteer button off is no command.

    Args:
        datum: place of the map's origin on earth.
    """

    name = "agopengps"
    peer_name = "AgOpenGPS"
    space_based = True

    def __init__(self, datum: Datum = DATUM) -> None:
        self._datum = datum
        self._angle_deg = 0.0  # measured last, positive to the right
        self._speed_kmh = 0.0
        self._roll_deg: float | None = None
        self._start: tuple[float, float, float] | None = None  # x, y [m], yaw [rad]
        self.ready = False  # until the autosteer button is on

    def begin(self, facts: RunFacts) -> None:
        """Keep the place where the vehicle waits."""
        x, y, yaw = facts.reference.at(0.0).state.tolist()[: State.PSI_I]
        self._start = x, y, yaw

    def receive(self, payload: bytes) -> Received:
        """Return the steering command of PGN 254, or the answer to a hello.

        Raises:
            Refused: no frame, wrong length, wrong checksum.
        """
        number, data = frames.parse(payload)
        if number == frames.HELLO:
            return Received(replies=(frames.hello_frame(self._angle_deg),))
        if number != frames.STEER:  # settings, sections, machine data: nothing for this plant
            return Received()
        steering = frames.steering(data)
        if not steering.engaged:
            return Received()
        self.ready = True
        return Received(RemoteCommand(tick=None, delta_t=-math.radians(steering.angle_deg)))

    def standing(self) -> Sequence[bytes]:
        """Return the place of the start, without motion."""
        assert self._start is not None
        return self._frames(*self._start)

    def period(self, data: TickData) -> Sequence[bytes]:
        """Return the position and the steering angle of a tick, as measured."""
        place: tuple[float, float] | None = None
        for item in data.samples:
            if item.sensor == Sensor.GNSS_TRACTOR:
                place = item.value[0], item.value[1]
            elif item.sensor == Sensor.ENCODER:
                self._speed_kmh = 3.6 * item.value[0]
            elif item.sensor == Sensor.STEERING_TRACTOR:
                self._angle_deg = -math.degrees(item.value[0])
            elif item.sensor == Sensor.IMU_TRACTOR:
                self._roll_deg = math.degrees(item.value[1])
        if place is None:
            return (frames.status_frame(self._angle_deg),)
        return self._frames(*place, float(data.estimate.state[State.PSI_T]))

    def end(self, status: str) -> Sequence[bytes]:
        """Return nothing: AgOpenGPS notices that positions cease."""
        del status
        return ()

    def _frames(self, x: float, y: float, yaw: float) -> Sequence[bytes]:
        latitude, longitude = self._datum.degrees(x, y)
        heading_deg = 90.0 - math.degrees(yaw)
        position = frames.position_frame(
            latitude, longitude, heading_deg, self._speed_kmh, self._roll_deg
        )
        return frames.status_frame(self._angle_deg), position
