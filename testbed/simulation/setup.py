"""Parts of a simulation, and what a control period hands from stage to stage."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ttempc.types import Command, ControlStep, Estimate, FloatArray, Measurement, VehicleGuidance
from ttempc.vehicle import Vehicle

from ..faults.faulty import Sensors
from ..ground.terrain import Terrain
from ..recording.record import Sink
from ..truth import Truth
from .deadline import STEP_LIMIT_S, CommandQueue
from .plant import Plant
from .termination import MeanSlip, TerminationLimits


@dataclass(frozen=True, slots=True)
class SimulationSetup:
    """All parts of one run."""

    plant: Plant
    sensors: Sensors
    guidance: VehicleGuidance
    vehicle: Vehicle  # model parameters; they give the input bounds in the log
    sink: Sink
    reference: FloatArray  # (n, len(REFERENCE.fields)) one row every `record_steps`
    control_steps: int  # physics steps in a control period
    record_steps: int  # physics steps from one row of the truth to the next
    terrain: Terrain  # the vehicle must stay on it
    termination: TerminationLimits = field(default_factory=TerminationLimits)
    notes: tuple[str, ...] = ()  # on path and tyres, for the log
    # Place of a point [m] among the rows of `reference`, with its fraction, where the reference is
    # followed by place; None where it is followed by time.
    place: Callable[[float, float], float] | None = None
    # Whether the command of a step that took longer than its period acts as much later
    realtime: bool = False
    step_limit_s: float = STEP_LIMIT_S  # see `time_limit`
    corridor_row: Callable[[Truth], list[float]] | None = None  # None on free ground

    def reference_row(self, step: int, truth: Truth) -> FloatArray:
        """Return the row of the reference that belongs to the truth at a step of the reference."""
        if self.place is None:
            return self.reference[step // self.record_steps]
        place = self.place(truth.tractor.x, truth.tractor.y)
        row = min(int(place), len(self.reference) - 2)
        share = place - row
        return (1.0 - share) * self.reference[row] + share * self.reference[row + 1]

    def behind_m(self, step: int, truth: Truth) -> float:
        """Return the way of the reference from the tractor to a step of it [m], 0 if it is past.

        It is 0 as well where the reference is followed by time.
        """
        if self.place is None:
            return 0.0
        rows = slice(
            int(self.place(truth.tractor.x, truth.tractor.y)), step // self.record_steps + 1
        )
        return float(np.hypot(*np.diff(self.reference[rows, :2].T)).sum())


@dataclass(slots=True)
class TickContext:
    """Data of one control period; a stage reads what earlier stages left and adds its own."""

    k: int = 0  # control tick, counted
    truths: list[tuple[int, Truth]] = field(default_factory=list)  # physics step, plant
    measurements: list[Measurement] = field(default_factory=list)
    estimate: Estimate | None = None
    control: ControlStep | None = None
    command: Command | None = None  # as it reaches the actuators; until then the previous one
    fallback: str = ""
    queue: CommandQueue = field(default_factory=CommandQueue)
    slip: MeanSlip = field(default_factory=MeanSlip)
    lost: str | None = None
    stopping: tuple[float, str] | None = None  # when and why the supervisor began to stop
    stopped: str = ""  # why, where a stop of the supervisor ends the run
    standing_s: float | None = None  # since when the vehicle that it has stopped stands
    reference_tick: int = 0  # tick of the reference that this control tick belongs to
    waits: bool = False  # whether the reference stays there for the period
    estimator_ns: int = 0
    control_ns: int = 0
    plant_ns: int = 0

    def reference_step(self, step: int, control_steps: int) -> int:
        """Return the physics step of the reference that belongs to one of this period."""
        begun = 0 if self.waits else step - self.k * control_steps
        return self.reference_tick * control_steps + begun

    @property
    def now(self) -> Truth:
        """The plant at the latest moment."""
        return self.truths[-1][1]


Stage = Callable[[SimulationSetup, TickContext], None]
