"""Controller and detector of a run over UDP: the peer's command, and its silence."""

from __future__ import annotations

from typing import Final

from ttempc.guidance.detection import Alarm, Observation, Reaction
from ttempc.guidance.supervisor import run_on
from ttempc.reference.path import Projection
from ttempc.reference.reference import Reference
from ttempc.types import Command, Estimate, Input, State
from ttempc.vehicle import Vehicle

from ..errors import InvalidController
from .protocol import CommandLink

_STRAIGHT: Final = 0.0  # [rad] trailer steering where the peer gives none


class RemoteController:
    """Controller that returns the command of a session's peer.

    Where the peer gives no hydrostat position, the speed of the reference is held,

        hp = hp_r + (v_r - v) / K,

    with the reference at the same place (space-based protocols) or time, and K of the model; the
    gain 1 / K is assumed. Where it gives no steering of the trailer, the trailer is towed with its
    steering straight.

    Args:
        vehicle: model parameters.
        reference: where both axle points should be over time.
        period_s: control period [s].
        link: to the peer.

    Raises:
        InvalidController: there is no link; such a run needs `ttempc serve`.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        reference: Reference,
        period_s: float,
        link: CommandLink | None = None,
    ) -> None:
        if link is None:
            raise InvalidController("this run was driven over UDP: use ttempc serve")
        self._link, self._gain = link, 1.0 / vehicle.speed_gain
        self.space_based = link.space_based
        grid = reference.on_grid(period_s)
        if self.space_based:
            grid = reference.on_grid(period_s, beyond=run_on(len(grid.time_s)))
            self._projection = Projection(grid.state[:, : State.PSI_T])
        self._grid = grid

    def step(self, estimate: Estimate, k: int) -> Command:
        """Return the latest command of the peer, before the first one that of the reference."""
        speed = float(estimate.state[State.V])
        if self.space_based:
            k = round(self._projection.place(*estimate.state[: State.PSI_T].tolist()))
        k = min(k, len(self._grid.time_s) - 1)
        command = self._link.command
        if command is None:
            return Command(*self._grid.inputs[k].tolist())
        hp = command.hp
        if hp is None:
            deviation = float(self._grid.state[k, State.V]) - speed
            hp = float(self._grid.inputs[k, Input.HP]) + self._gain * deviation
        delta_i = _STRAIGHT if command.delta_i is None else command.delta_i
        return Command(command.delta_t, delta_i, hp)


class SilenceDetector:
    """Detector of a peer that sends no command: the supervisor stops until it does again.

    Args:
        link: to the peer.
        limit: time without a command after which the vehicle stops [s].
    """

    name = "command link"

    def __init__(self, link: CommandLink, limit: float) -> None:
        self._link, self.limit = link, limit

    @property
    def statistic(self) -> float:
        """Time since the latest command [s], simulated."""
        return self._link.silence_s

    @property
    def residual(self) -> float:
        """The same."""
        return self._link.silence_s

    def observe(self, observation: Observation) -> None:
        """Nothing: the session counts the ticks."""

    def alarm(self) -> Alarm:
        """Return the alarm that stops the vehicle."""
        reason = f"no command over UDP for more than {self.limit:g} s"
        return Alarm(self.name, reason, Reaction.STOP)
