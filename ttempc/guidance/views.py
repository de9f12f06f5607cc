"""Views of the last update and the last step of a guidance."""

from __future__ import annotations

from dataclasses import replace

from ..detectors.interface import Alarm, Detector
from ..detectors.monitors import Monitors
from ..errors import GuidanceFailed
from ..layout import Innovations, estimate_view
from ..reference.reference import Reference
from ..types import Command, ControlStep, Diagnostics, Estimate, FloatArray
from ..vehicle import Vehicle
from .parts import Parts
from .supervisor import Supervisor


class GuidanceViews:
    """Views of the records of a guidance, made when somebody looks; see `Guidance`."""

    period_s: float  # control period [s]
    tick: int  # number of the next control tick
    reference_tick: int  # of the reference at that tick: those that waited apart
    estimate_record: FloatArray  # `ttempc.layout.ESTIMATE` of the last update
    learnt: tuple[str, ...]  # model parameters that act from the last step on
    _supervisor: Supervisor
    _parts: Parts
    _monitors: Monitors
    _innovations: FloatArray  # of the last update
    _sent: FloatArray  # the last command
    _view: Estimate | None  # of the last update, once somebody has looked
    _control_step: ControlStep | None  # likewise of the last step

    @property
    def vehicle(self) -> Vehicle:
        """Model parameters, those that were learnt included."""
        return self._parts.vehicle

    @property
    def reference(self) -> Reference:
        """The reference that is followed, for the present model parameters."""
        return self._parts.reference

    @property
    def finished(self) -> bool:
        """Whether the next tick lies at or beyond the end of the reference."""
        return self.reference_tick * self.period_s >= self.reference.duration_s - 1e-9

    @property
    def detectors(self) -> tuple[Detector, ...]:
        """Detectors of faults, each with its present statistic."""
        return self._monitors.detectors

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Alarms of the detectors that stand since the last update, by detector."""
        return self._monitors.alarms

    @property
    def space_based(self) -> bool:
        """Whether the controller follows the reference by place and not by time."""
        return self._supervisor.space_based

    @property
    def tick_record(self) -> FloatArray:
        """Record `ttempc.layout.TICK` of the last step; `diagnostics` is its view."""
        return self._supervisor.tick

    @property
    def stopping(self) -> bool:
        """Whether the supervisor stops the vehicle, or holds it at rest."""
        return self._supervisor.stopping

    @property
    def solve_time_s(self) -> float:
        """Time of the last step's solver as it reports it [s]; 0 where none was needed."""
        return self._supervisor.solve_time_s

    def predicted_path(self) -> FloatArray | None:
        """Return `Diagnostics.predicted_path` of the last step; call it before `prepare`."""
        return self._supervisor.predicted_path()

    @property
    def control_step(self) -> ControlStep:
        """Command and diagnostics of the last `step`.

        Raises:
            GuidanceFailed: there was no step yet.
        """
        if self._control_step is None:
            if not self.tick:
                raise GuidanceFailed("control_step: call step() first")
            diagnostics = replace(self._supervisor.diagnostics(), learnt=self.learnt)
            self._control_step = ControlStep(Command(*self._sent.tolist()), diagnostics)
        return self._control_step

    @property
    def diagnostics(self) -> Diagnostics:
        """Explanation of the last command: actions, solver, tracking error, fallback."""
        return self.control_step.diagnostics

    def _seen(self) -> Estimate:
        """Return the view of the present estimate."""
        if self._view is None:
            self._view = estimate_view(self.estimate_record, Innovations(self._innovations))
        return self._view
