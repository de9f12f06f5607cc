"""Reports of a guidance: what its last update and its last step found and did."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ..detectors.interface import Alarm, Detector
from ..detectors.monitors import Monitors
from ..errors import GuidanceFailed
from ..layout import INNOVATION, TICK, Innovations, estimate_view
from ..reference.reference import Reference
from ..types import Command, ControlStep, Diagnostics, Estimate, FloatArray, Input
from ..vehicle import Vehicle
from .pipeline import Pipeline
from .safety import HOLD, NOT_STARTED
from .supervisor import Supervisor


class GuidanceReport:
    """Parts and records of a guidance, and views of them that are made when somebody looks."""

    def __init__(
        self, pipeline: Pipeline, monitors: Monitors, supervisor: Supervisor, period_s: float
    ) -> None:
        self._pipeline = pipeline
        self._monitors = monitors
        self._supervisor = supervisor

        self.period_s = period_s
        """Control period [s]."""
        self.tick = 0
        """Number of the next control tick."""
        self.reference_tick = 0
        """Tick of the reference at that tick: without those at which it waited."""
        self.estimate_record: FloatArray = np.empty(0)
        """Record `ttempc.layout.ESTIMATE` of the last update."""
        self.learnt: tuple[str, ...] = ()
        """Model parameters that were learnt and act from the last step on, in words."""

        self._sent = np.full(len(Input), math.nan)  # the last command
        self._innovations = np.empty((0, INNOVATION))  # rows of the last update
        self._estimate: Estimate | None = None  # of the last update, once looked at
        self._control_step: ControlStep | None = None  # of the last step, once looked at

    @property
    def vehicle(self) -> Vehicle:
        """Model parameters, those that were learnt included."""
        return self._pipeline.vehicle

    @property
    def reference(self) -> Reference:
        """The reference that is followed, for the present model parameters."""
        return self._pipeline.reference

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
    def waits_for_estimate(self) -> bool:
        """Whether the command was held for the first estimate, as at every start; no stop."""
        tick = self._supervisor.tick.view(TICK)[0]
        return bool(tick["reason"] == NOT_STARTED and tick["mode"] == HOLD)

    @property
    def stopping(self) -> bool:
        """Whether the supervisor stops the vehicle, or holds it at rest."""
        return self._supervisor.stopping

    @property
    def solve_time_s(self) -> float:
        """Time of the last step's solver as it reports it [s]; 0 where none was needed."""
        return self._supervisor.solve_time_s

    @property
    def diagnostics(self) -> Diagnostics:
        """Explanation of the last command: actions, solver, tracking error, fallback."""
        return self.control_step.diagnostics

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

    def predicted_path(self) -> FloatArray | None:
        """Return `Diagnostics.predicted_path` of the last step; call it before `prepare`."""
        return self._supervisor.predicted_path()

    def _seen_estimate(self) -> Estimate:
        """Return the view of the present estimate, made when somebody looks."""
        if self._estimate is None:
            self._estimate = estimate_view(self.estimate_record, Innovations(self._innovations))
        return self._estimate
