"""Environment of Gymnasium: one run of a scenario, a control period a step."""

import math
from collections.abc import Generator, Mapping, Sequence
from typing import Any, Final, Literal

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from numpy.typing import NDArray

from ttempc.layout import TICK
from ttempc.reference.reference import Reference
from ttempc.types import Command, Controller, Estimate, FloatArray
from ttempc.vehicle import CommandLimits, Vehicle

from ....testbed.recording.record import Tee
from ....testbed.simulation.loop import (
    Outcome,
    estimate,
    log_timing,
    log_truth,
    periods,
    prepare,
    sense,
)
from ....testbed.simulation.setup import SimulationSetup, TickContext
from ....testbed.terminal import one_line
from ....testbed.truth import Truth
from ...errors import BadOptions, InvalidScenario
from ...run.assembly import assemble, check, model_vehicle
from ...run.shared_parts import SharedParts
from ...run.user_code import named_parts, refuse_untrusted
from ...scenario.scenario import parse_overrides, read_scenario
from .policy import ESTIMATE_NAMES, EstimateObserver, add_residual, bounds, half_range

ERROR_M: Final = 0.1
"""Distance of both points from their reference that halves the reward; assumed."""

EFFORT: Final = 0.1
"""Cost where all commands change as fast as the vehicle allows; assumed: as an error of 3 cm."""

_LEFT_OUT: Final = (prepare, log_truth, log_timing)  # of real time and the log
_SEEDS: Final = 2**32  # as of `ttempc run --seed`
# Attributes of Gymnasium that a copy takes over: generators, and the place in its registry.
_COPIED: Final = ("_np_random", "_np_random_seed", "action_space", "observation_space", "spec")

Action = Literal["command", "residual"]
Entries = NDArray[np.float32]


def _one_of(given: object, *allowed: object) -> bool:
    return any(type(given) is type(one) and given == one for one in allowed)


def _refuse_arguments(given: Mapping[str, Any]) -> None:
    """Refuse arguments of `FieldTrial`, by their names, that have none of the allowed values.

    Raises:
        BadOptions: one has not.
    """
    overrides = given["overrides"]
    listed = isinstance(overrides, list | tuple)
    share = given["residual_share"]
    render_mode = given["render_mode"]
    rules = (
        ("scenario", "a text", isinstance(given["scenario"], str)),
        ("overrides", "a list of texts", listed and all(isinstance(one, str) for one in overrides)),
        ("action", "command or residual", _one_of(given["action"], "command", "residual")),
        ("normalised", "True or False", isinstance(given["normalised"], bool)),
        (
            "residual_share",
            "above 0 and at most 1",
            isinstance(share, int | float) and 0 < share <= 1,
        ),
        ("trust", "True or False", isinstance(given["trust"], bool)),
        ("render_mode", "rgb_array or None", _one_of(render_mode, None, "rgb_array")),
    )
    for name, allowed, is_right in rules:
        if not is_right:
            raise BadOptions(one_line(f"{name}: must be {allowed}, got {given[name]!r}"))


def _three_numbers(action: object) -> FloatArray:
    """Return an action as an array (3,) of floats.

    Raises:
        ValueError: it is not of three numbers.
    """
    try:
        values = np.asarray(action)
        # An array of objects is converted entry by entry; text and complex numbers are refused
        casting = "unsafe" if values.dtype == object else "same_kind"
        values = values.astype(float, casting=casting)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(one_line(f"step: the action must be three numbers: {error}")) from None
    if values.shape != (3,):
        raise ValueError(f"step: the action has the shape {values.shape}, must be (3,)")
    return values


def reward(errors_m: Sequence[float], change: Sequence[float]) -> float:
    """Return the reward of a period, above 0 and at most 1.

        reward = 1 / (1 + mean((e / ERROR_M)^2) + EFFORT mean(c^2))

    It is bounded without a limit that hides which of two large errors is larger. It is never
    negative, and a run that ends early has no further rewards: no policy gains by ending one.
    `errors_m`: true distances e of both points from their references; `change`: those c of the
    commands in a period, as shares of the largest ones.
    """
    error = sum(e * e for e in errors_m) / (len(errors_m) * ERROR_M**2)
    effort = sum(c * c for c in change) / len(change)
    return 1.0 / (1.0 + error + EFFORT * effort)


class FieldTrial(gymnasium.Env[Entries, Entries]):
    """A run of a scenario; `reset(seed=N)` starts the run of `ttempc run --seed N`.

    Estimator and supervisor of the run stay in place; the action replaces the
    command of the controller, or is added to it. `observation_names` has the entries of what a
    policy sees.

    A copy, by `copy.deepcopy` or `pickle`, starts the run anew and drives it with the actions so
    far, which gives the same state bit for bit in the time that they took: MuJoCo's model and the
    threads of a run cannot be copied.

    Args:
        scenario: name of a scenario that ships, or path of a TOML file.
        overrides: lines `key.key=value` that replace values of the scenario.
        action: "command", or "residual" on the controller of the scenario.
        normalised: whether a command of -1 to 1 spans the vehicle's limits and entries of the
            observation are scaled to -1 to 1; else both are in the units of their names. A residual
            is always from -1 to 1.
        residual_share: of half the range of a command that a residual of 1 adds.
        trust: whether code that the scenario file names may run.
        render_mode: "rgb_array": `render` returns a picture of the vehicle; None: it draws nothing.

    Raises:
        BadOptions: an argument has none of the allowed values.
        NoGraphics: pictures are asked for and off-screen OpenGL is unavailable.
        ExperimentError, TestbedError, TtempcError: as a run of the scenario.
    """

    observation_names = ESTIMATE_NAMES
    max_episode_steps: int
    """Control periods of the whole reference; waiting for the vehicle adds to them."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 5}  # noqa: RUF012 - Gymnasium's own

    def __init__(
        self,
        scenario: str = "grass",
        overrides: Sequence[str] = (),
        *,
        action: Action = "command",
        normalised: bool = True,
        residual_share: float = 0.25,
        trust: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self._arguments = {
            "scenario": scenario,
            "overrides": overrides,
            "action": action,
            "normalised": normalised,
            "residual_share": residual_share,
            "trust": trust,
            "render_mode": render_mode,
        }
        _refuse_arguments(self._arguments)

        # The scenario, the vehicle and its limits
        source = read_scenario(scenario)
        changes = parse_overrides(overrides)
        self._scenario = source.scenario(changes, changed_by="overrides")
        if not trust:
            refuse_untrusted(source.file, named_parts(self._scenario), changes)
        self.max_episode_steps = check(self._scenario)
        mission = self._scenario.mission()
        self._vehicle = model_vehicle(mission, self._scenario, self._scenario.vehicles())
        self._limits = CommandLimits.of(self._vehicle, self._scenario.control.period_s)

        # What a policy sees, and what it answers
        largest, scale = bounds(ESTIMATE_NAMES)
        self._scale = scale.astype(np.float32) if normalised else None
        largest = np.ones(len(scale), np.float32) if normalised else largest.astype(np.float32)
        self.observation_space = Box(-largest, largest, dtype=np.float32)
        self._residual = action == "residual"
        self._share = residual_share
        self._normalised = normalised and not self._residual
        low = self._limits.lower
        high = self._limits.upper
        if normalised or self._residual:
            low = -np.ones(3)
            high = np.ones(3)
        self.action_space = Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)

        # Pictures, and the run, which `reset` starts
        self.render_mode = render_mode
        self._camera = None
        if render_mode:
            from .picture import Camera

            self._camera = Camera()
        self._parts = SharedParts(terrains=1, controllers=1)
        self._action = np.zeros(3)  # as the controller takes it
        self._run: Generator[TickContext, None, Outcome] | None = None
        self._run_seed: int | None = None  # None: no run was started yet
        self._actions: list[FloatArray] = []  # of the run so far

    def __getstate__(self) -> dict[str, Any]:
        """Return what starts the run of a copy and brings it to the present tick."""
        return {
            "arguments": self._arguments,
            "run_seed": self._run_seed,
            "actions": self._actions,
            "attributes": {name: vars(self)[name] for name in _COPIED if name in vars(self)},
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the environment of the same arguments and repeat the run."""
        self.__init__(**state["arguments"])
        if state["run_seed"] is not None:
            self._start(state["run_seed"])
            for action in state["actions"]:
                self.step(action)
        vars(self).update(state["attributes"])  # last: the repeated run draws nothing from them

    @property
    def truth(self) -> Truth:
        """True state of the plant at the present tick, for tests and for critics of a policy."""
        return self._tick.now

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Entries, dict[str, Any]]:
        """Start the run of a seed, by default of the next one of the environment's generator.

        Raises:
            BadOptions: the seed is above 2**32 - 1.
        """
        super().reset(seed=seed, options=options)
        if seed is not None and seed >= _SEEDS:
            raise BadOptions(f"seed: must be from 0 to {_SEEDS - 1}, got {seed}")
        run_seed = int(self.np_random.integers(_SEEDS)) if seed is None else seed
        return self._start(run_seed), {"seed": run_seed, "time_s": 0.0}

    def _start(self, run_seed: int) -> Entries:
        """Assemble the run of a seed and drive it to the first observation."""
        assembly = assemble(self._scenario, run_seed, self._controller, self._parts)
        self._reference = assembly.guidance.reference
        period_s = assembly.guidance.period_s
        self._setup: SimulationSetup = assembly.setup(Tee(), 1.0 / period_s)
        self._guidance = assembly.guidance
        self._ticks = assembly.ticks
        stages = tuple(stage for stage in assembly.stages if stage not in _LEFT_OUT)
        self._run = periods(self._setup, self._ticks, stages, lambda k: None)
        self._run_seed = run_seed
        self._actions = []
        self._sent = self._limits.clamp(self._reference.at(0.0).inputs)
        self._estimates = EstimateObserver(self._reference, period_s)
        outcome = self._proceed()
        if outcome is not None:
            raise InvalidScenario(f"reset: the run ended before it started: {outcome.failure}")
        return self._observe()

    def step(self, action: Entries) -> tuple[Entries, float, bool, bool, dict[str, Any]]:
        """Drive a control period.

        `info` has the distances of both points from their references, the fallback of the
        supervisor where one acted, and at the end status, failure and time of the run.

        Raises:
            ResetNeeded: the run has ended.
            ValueError: the action is not of three numbers.
        """
        if self._run is None:
            raise ResetNeeded("step: the run has ended, call reset()")
        values = _three_numbers(action)
        self._actions.append(values)
        if self._normalised:
            values = np.clip(values, -1.0, 1.0)
            middle = 0.5 * (self._limits.upper + self._limits.lower)
            values = middle + half_range(self._limits) * values
        self._action = values
        outcome = self._proceed()

        # Reward of the true errors and of the change of what was sent
        errors = self._errors_m()
        previous = self._sent
        self._sent = self._guidance.tick_record.view(TICK)[0]["control"][:, 4].copy()
        change = (self._sent - previous) / self._limits.step
        gained = reward(errors, change.tolist())

        info: dict[str, Any] = {"tractor_error_m": errors[0], "trailer_error_m": errors[1]}
        if self._tick.fallback:
            info["fallback"] = self._tick.fallback
        if outcome is None:
            return self._observe(), gained, False, False, info

        self._run = None
        info |= {"status": outcome.status, "failure": outcome.failure or ""}
        info["time_s"] = outcome.duration_s
        if outcome.status != "invalid":
            for stage in (sense, estimate):  # of the tick that no command follows
                stage(self._setup, self._tick)
        completed = outcome.status == "completed"
        return self._observe(), gained, not completed, completed, info

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Return the picture of the camera that follows the vehicle, (480, 640, 3).

        Raises:
            ResetNeeded: no run was started yet.
        """
        if self._camera is None:
            return None
        if not hasattr(self, "_setup"):
            raise ResetNeeded("render: call reset() first")
        return self._camera.picture(self._setup.plant)

    def _controller(
        self, vehicle: Vehicle, reference: Reference, period_s: float, **options: object
    ) -> Controller:
        """Return the controller that takes the actions; `options` are the scenario's."""
        del options
        if not self._residual:
            return _Actions(self)
        make = self._parts.controller_factory(self._scenario, self._vehicle)
        inner = make(vehicle, reference, period_s)
        return add_residual(inner, self._chosen, self._share, reference, period_s)

    def _chosen(self, estimate: Estimate, k: int, sent: FloatArray) -> FloatArray:
        return self._action

    def _proceed(self) -> Outcome | None:
        """Run to the next tick that needs a command; return the outcome where there is none."""
        assert self._run is not None
        with self._setup.deadline.watch():
            try:
                self._tick = next(self._run)
            except StopIteration as end:
                return end.value
        return None

    def _observe(self) -> Entries:
        tick = self._tick
        k = self._guidance.reference_tick
        assert tick.estimate is not None
        if self._guidance.reference is not self._reference:  # the model was learnt anew
            self._reference = self._guidance.reference
            self._estimates = EstimateObserver(self._reference, self._guidance.period_s)
        entries = self._estimates.observe(tick.estimate, k, self._sent)
        return entries if self._scale is None else np.clip(entries / self._scale, -1.0, 1.0)

    def _errors_m(self) -> tuple[float, float]:
        """Return the true distances of both points from their references [m]."""
        now = self._tick.now
        setup = self._setup
        # The next tick has begun, unless the run has ended: the reference is that of now.
        step = self._guidance.reference_tick * setup.control_steps
        x_t, y_t, _, x_i, y_i = setup.reference_row(step, *now.tractor[:2])[:5].tolist()
        return math.dist(now.tractor[:2], (x_t, y_t)), math.dist(now.trailer[:2], (x_i, y_i))


class _Actions(Controller):
    """Controller whose command is the action of an environment; the supervisor limits it."""

    def __init__(self, environment: FieldTrial) -> None:
        self._environment = environment

    def step(self, estimate: Estimate, k: int) -> Command:
        """Return the action as a command."""
        return Command(*self._environment._action.tolist())
