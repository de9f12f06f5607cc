"""Parts of a simulation, and what a control period hands from stage to stage."""

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from ttempc.layout import SAMPLE, measurements_of
from ttempc.types import Command, ControlStep, Estimate, FloatArray, Measurement, VehicleGuidance

from ..ground.terrain import Terrain
from ..recording.channels import Channel
from ..recording.record import Sink
from ..sensing.sensors import SensorSuite
from ..truth import Truth, TruthBlock
from .deadline import Deadline
from .plant import Plant
from .termination import MeanSlip, TerminationLimits


@dataclass(frozen=True, slots=True)
class SimulationSetup:
    """All parts of one run."""

    plant: Plant
    sensors: SensorSuite
    guidance: VehicleGuidance
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
    deadline: Deadline = field(default_factory=Deadline)  # limit of each call of the guidance
    # Further channels, each with a function from truths in the order of time and the rows of
    # their reference to its rows
    judges: Sequence[tuple[Channel, Callable[[TruthBlock, FloatArray], FloatArray]]] = ()

    def reference_row(self, step: int, x: float, y: float) -> FloatArray:
        """Return the row of the reference for a tractor at (x, y) [m] and a step of the reference.

        The place decides where the reference is followed by place, else the step.
        """
        if self.place is None:
            return self.reference[step // self.record_steps]
        place = self.place(x, y)
        row = min(int(place), len(self.reference) - 2)
        share = place - row
        return (1.0 - share) * self.reference[row] + share * self.reference[row + 1]

    def reference_rows(self, first: int, stride: int, truths: TruthBlock) -> FloatArray:
        """Return the rows of the reference for truths, as `reference_row`, (n, fields).

        They belong to steps of the reference from `first` on, `stride` apart; 0 where it waits.
        """
        count = len(truths.rows)
        if self.place is None and stride:
            row = first // self.record_steps
            return self.reference[row : row + count * (stride // self.record_steps)]
        places = truths.rows[:, 1:3].tolist()
        return np.array([self.reference_row(first, x, y) for x, y in places])

    def distance_left_m(self, step: int, x: float, y: float) -> float:
        """Return the distance along the reference from (x, y) to its step [m], 0 if it is past.

        It is 0 as well where the reference is followed by time.
        """
        if self.place is None:
            return 0.0
        rows = slice(int(self.place(x, y)), step // self.record_steps + 1)
        return float(np.hypot(*np.diff(self.reference[rows, :2].T)).sum())


class TickContext:
    """Data of one control period; a stage reads what earlier stages left and adds its own.

    `now` is the plant at the last of the `truths`, which are those since the previous tick, at
    their physics `steps`. `measurements` and `control` are views, made when someone asks for them.
    """

    def __init__(self, setup: SimulationSetup) -> None:
        self.k = 0  # number of the control tick
        self._guidance = setup.guidance
        self.timestep_s = setup.plant.timestep_s  # length of a physics step [s]
        # physics steps from one moment to the next
        self.stride = math.gcd(setup.control_steps, setup.record_steps, setup.sensors.every)
        self.drive_to(0, setup.plant.present())
        self.sensed(np.empty((0, SAMPLE)))
        self.estimate: Estimate | None = None
        # as it reaches the actuators; until then the previous one
        self.command: Command | None = None
        self.fallback = ""
        # physics step from which each of the commands under way acts; the first one acts now
        self.commands: deque[tuple[int, Command]] = deque()
        self.slip = MeanSlip()
        self.lost: str | None = None
        self.stopping: tuple[float, str] | None = None  # when and why the supervisor began to stop
        self.stopped = ""  # why, where a stop of the supervisor ends the run
        self.standing_s: float | None = None  # since when the vehicle that it has stopped stands
        self.reference_tick = 0  # tick of the reference that this control tick belongs to
        self.waits = False  # whether the reference stays there for the period
        self.estimator_ns = self.control_ns = self.plant_ns = 0

    def drive_to(self, step: int, truths: TruthBlock) -> None:
        """Take over the truths up to a physics step, the last of them."""
        self.truths = truths
        count = len(truths.rows)
        self.steps = range(step - (count - 1) * self.stride, step + 1, self.stride)
        self.now: Truth = truths.truth(-1)

    def command_at(self, step: int, end: int) -> tuple[Command, int]:
        """Return the command that acts at a physics step, and the step up to which it does.

        Commands act in the order of sending, each from its physics step on, at most up to `end`.
        """
        queue = self.commands
        while len(queue) > 1 and queue[1][0] <= step:
            queue.popleft()
        until = min(end, queue[1][0]) if len(queue) > 1 else end
        return queue[0][1], until

    def sensed(self, samples: FloatArray) -> None:
        """Take over the samples of the period as rows, see `ttempc.layout.SAMPLE`."""
        self._rows: FloatArray = samples
        self._measurements: list[Measurement] | None = None

    @property
    def samples(self) -> FloatArray | list[Measurement]:
        """Samples of the period: rows, or objects where a stage has asked for them."""
        return self._rows if self._measurements is None else self._measurements

    @property
    def measurements(self) -> list[Measurement]:
        """Samples of the period in the order of delivery; a stage may change the list."""
        if self._measurements is None:
            self._measurements = measurements_of(self._rows)
        return self._measurements

    @measurements.setter
    def measurements(self, samples: list[Measurement]) -> None:
        self._measurements = samples

    @property
    def control(self) -> ControlStep:
        """The last command and its explanation."""
        return self._guidance.control_step

    def reference_step(self, step: int, control_steps: int) -> int:
        """Return the physics step of the reference that belongs to one of this period."""
        begun = 0 if self.waits else step - self.k * control_steps
        return self.reference_tick * control_steps + begun


Stage = Callable[[SimulationSetup, TickContext], None]
