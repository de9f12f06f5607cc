"""Options of the controllers with an MPC on the articulated model."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

import numpy as np

from ..errors import check_choice, check_flag, check_positive, check_vector
from ..mpc.condensing import FreeSteps
from ..mpc.lmpc import HorizonTuning
from ..reference.corridor import SpeedTube
from ..reference.reference import GUIDED, Guided
from ..tuning import SearchRange
from ..types import FloatArray, Input
from ..vehicle import Vehicle

_PERIOD_S: Final = 0.2  # of the paper, for which horizon and weights are given
_WEIGHTS_MPS: Final = 1.0  # speed for which they are given, the paper's
ROUNDING: Final = 1e-9
# Of the trailer's step weight with a tool, which a turn of the trailer moves across at once. Of 4,
# 6 and 9, and of 1, 2, 4 and 8 times the speed, that of least error at the tool on passes at 1.4,
# 2.8 and 4.2 m/s and in curves (seeds 21 to 23); with the speed alone it swings over waves of 4 to
# 7 m
_TOOL_FACTOR: Final = 6.0
_PUSHING_FACTOR: Final = 6.0  # 4 and 10 give the same errors over 30 m, 1 lets the trailer swing
# Of both step weights in reverse with a trailer that steers: 1.5 to 6 of the front's and 3 to 6 of
# the trailer's give the same errors, 1 and 1 end in swings at the limit of the front's rate
# (`work-reverse`, 2 of the seeds 21 to 28; a wet slope, 1 of 3)
_REVERSE_FRONT_FACTOR: Final = 2.0
_REVERSE_TRAILER_FACTOR: Final = 3.0


def motion_ratio(vehicle: Vehicle, speed_mps: float) -> FloatArray:
    """Return the motion by a unit of each input over that of the paper's vehicle at 1 m/s, (3,)."""
    return vehicle.motion_per_input(speed_mps) / Vehicle().motion_per_input(_WEIGHTS_MPS)


def speed_factor(vehicle: Vehicle, speed_mps: float) -> float:
    """Return the square of a speed above 1 m/s, by which a steering weighs more.

    In reverse, where the bodies fold by themselves, a slower loop would not hold them: 1.
    """
    if vehicle.reverse:
        return 1.0
    return max(speed_mps / _WEIGHTS_MPS, 1.0) ** 2


def steering_step_factors(vehicle: Vehicle, speed_mps: float) -> tuple[float, float]:
    """Return the factors of the step weights of front and trailer steering at a speed.

    Steering moves a body across its path in proportion to the speed. With a cost q y^2 + r u'^2 and
    y' = g u the crossover of a loop is (q g^2 / r)^(1/4), with y'' = g u it is (q g^2 / r)^(1/6).
    With the same weights it grows with the speed, while the lags that the model leaves out do not
    shrink: tyres, dead times, the filter. The front steering, g = v^2 / L_t, has `speed_factor` and
    the square root of its lateral acceleration, from that of the paper's vehicle at 1 m/s on: the
    crossover grows with the speed to 1/6. The trailer's, g in proportion to v, has the root of
    `speed_factor`: the crossover grows with the speed to 1/4. With constant crossovers the errors
    at 4 m/s are larger by a tenth. With a tool it has a factor of its own at every speed, see
    `_TOOL_FACTOR`.
    """
    lateral = float(motion_ratio(vehicle, speed_mps)[Input.DELTA_T])
    factor = speed_factor(vehicle, speed_mps)
    with_tool = vehicle.tool_behind and not vehicle.reverse
    trailer = _TOOL_FACTOR if with_tool else math.sqrt(factor)
    return factor * math.sqrt(max(lateral, 1.0)), trailer


@dataclass(frozen=True)
class MpcOptions(HorizonTuning):
    """Horizon, weights and bounds of an MPC on the articulated error model.

    The outputs are x and y of tractor and trailer in the frames of their references. The horizon
    is four seconds, with six free steps of 0.2 s each. The weights are the best of 49 sets on the
    benchmark's trials and other fields (tuning seeds), as those of the rivals are, with an entry
    that is no worse: the trailer's cross-track error weighs more than the tractor's, since the
    working point is behind.

    Horizon and weights are those of a period of 0.2 s and the vehicle of the paper at 1 m/s;
    `for_vehicle` has those of others.
    """

    outputs: ClassVar[int] = 4
    search_space: ClassVar[tuple[SearchRange, ...]] = (
        SearchRange("output_weight", 0.5, 12.0, entry=3),
        SearchRange("step_weight", 0.02, 1.0, entry=0),
        SearchRange("step_weight", 0.01, 0.5, entry=1),
        SearchRange("step_weight", 0.04, 1.0, entry=2),
    )

    horizon: int = 20  # N_p, predicted periods of 0.2 s
    moves: int = 6  # N_c, free input steps of 0.2 s
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 2.5)  # [1/m^2]
    # [1/rad^2], [1/rad^2], for a hydrostat position as a fraction
    step_weight: tuple[float, ...] = (0.15, 0.07, 0.15)
    # [rad], [rad], fraction
    input_bound: tuple[float, ...] = (math.radians(25.0), math.radians(20.0), 0.5)
    # tau of y + tau y', which is in the place of the cross-track errors y in the cost while the
    # vehicle enters its line from beside it; of an NMPC always [s]
    damping_s: float = 1.5

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        check_positive("damping_s", self.damping_s, zero=True)

    def for_vehicle(self, vehicle: Vehicle, speed_mps: float, period_s: float) -> Self:
        """Return the options for a vehicle, the largest speed of its reference and a period.

        - Horizon and free steps span the same time. With n steps in place of one, a ramp of an
          input has the n-th part of its cost and the errors n times theirs, hence the factor n^2
          of all step weights.
        - A step of the hydrostat has the cost of the same change of acceleration
          (`Vehicle.motion_per_input`): a drive of three times the gain cycles at the limit of its
          rate otherwise.
        - The weights of both steerings grow with the speed, see `steering_step_factors`.
        - In reverse steps of both steerings weigh more, twice and three times; with a plain
          trailer, which the front steering alone keeps from folding, a step of it weighs six times
          as much, as in `lqr`: without it the bodies swing.
        """
        steps = _PERIOD_S / period_s
        drive = motion_ratio(vehicle, speed_mps)[Input.HP]
        of_front, of_trailer = steering_step_factors(vehicle, speed_mps)
        front, trailer, hp = (steps**2 * weight for weight in self.step_weight)
        if vehicle.reverse:
            front *= _PUSHING_FACTOR if vehicle.is_plain else _REVERSE_FRONT_FACTOR
            trailer *= _REVERSE_TRAILER_FACTOR
        return replace(
            self,
            horizon=math.ceil(steps * self.horizon - ROUNDING),
            moves=math.ceil(steps * self.moves - ROUNDING),
            step_weight=(of_front * front, of_trailer * trailer, float(drive**2) * hp),
        )

    def free_steps(self, period_s: float) -> FreeSteps:
        """Return the free steps of options for a period, see `for_vehicle`: every 0.2 s one.

        The first is that of one period, which is the command; at shorter periods the others stand
        for several, so that the QP has the unknowns of 5 Hz at any rate.
        """
        periods = max(1.0, _PERIOD_S / period_s)
        return FreeSteps.blocks(math.ceil(self.moves / periods - ROUNDING), periods)


@dataclass(frozen=True)
class NominalOptions(MpcOptions):
    """Options of `ttempc-nominal`; its weights are those of a search of its own, of 39 sets."""

    # As of `MpcOptions`; with front wheels near their stop turned starts settle earlier
    input_bound: tuple[float, ...] = (math.radians(32.0), math.radians(20.0), 0.5)
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 3.36)
    step_weight: tuple[float, ...] = (0.1, 0.095, 0.32)
    disturbances: bool = True  # whether the MPC uses the disturbances that the filter estimates
    corridor: bool = True  # whether the MPC keeps to the corridor of the reference, if any
    hitch_limit_deg: float = 45.0  # largest |beta| of plans; that of the corridor where less
    guided: Guided = "tool"  # the point behind that keeps to its line; without a tool the axle
    # Half widths that tractor and trailer keep about the path: h_0, and h_1 by which they grow with
    # the speed. Whoever plans the reference drives a corridor as slowly as they ask, see
    # `ttempc.reference.corridor.SpeedTube`.
    corridor_at_rest_m: tuple[float, float] = (0.0, 0.0)
    corridor_per_speed_s: tuple[float, float] = (0.0, 0.0)

    @property
    def speed_tube(self) -> SpeedTube | None:
        """Return the half widths over speed; None where the MPC does not keep to a corridor."""
        if not self.corridor:
            return None
        return SpeedTube(self.corridor_at_rest_m, self.corridor_per_speed_s)

    def __post_init__(self) -> None:
        MpcOptions.__post_init__(self)
        check_flag("disturbances", self.disturbances)
        check_flag("corridor", self.corridor)
        check_positive("hitch_limit_deg", self.hitch_limit_deg)
        check_choice("guided", self.guided, GUIDED)
        SpeedTube(self.corridor_at_rest_m, self.corridor_per_speed_s)


@dataclass(frozen=True)
class ArticulatedOptions(NominalOptions):
    """Options of `ttempc`: its MPC, its robust law and its tube, in the order of `Input`.

    The weights of `ttempc-nominal` gain 2 % on the benchmark's trials and lose 9 % of the overshoot
    on a wet slope and 14 % in travel of the front steering.
    """

    output_weight: tuple[float, ...] = MpcOptions.output_weight
    step_weight: tuple[float, ...] = MpcOptions.step_weight
    # Largest action k_s [rad], [rad], fraction; the paper's.
    saturation: tuple[float, float, float] = (0.2, 0.1, 0.10)
    # Cost of an action [1/rad^2], [1/rad^2], 1, beside errors of both points at 1 / m^2 each: 2 cm
    # weigh as much as 2 deg of steering or 4 % of the hydrostat. For the vehicle of the paper up to
    # 1 m/s.
    input_weight: tuple[float, float, float] = (0.3, 0.3, 0.3)
    memory_s: float = 5.0  # time constant of the autocorrelation's average [s]
    # Whether the robust law acts: the saturated tanh action u_m alone. The tube stays.
    robust: bool = True
    # Whether the growing tube acts: it tightens the inputs at each stage of the horizon and backs
    # up the last plan. The robust law stays. Without a tube's design nothing is tightened.
    tube: bool = True

    def __post_init__(self) -> None:
        NominalOptions.__post_init__(self)
        check_vector("saturation", self.saturation, len(Input))
        check_vector("input_weight", self.input_weight, len(Input))
        check_positive("memory_s", self.memory_s)
        check_flag("robust", self.robust)
        check_flag("tube", self.tube)

    def for_vehicle(self, vehicle: Vehicle, speed_mps: float, period_s: float) -> Self:
        """Return the options for a vehicle, as `MpcOptions.for_vehicle`.

        A robust action has the cost of the same motion, and none less than the one given. With a
        fixed cost the loop's gain grows with the speed, and above 3 m/s the lags that the kinematic
        model leaves out make steering and drawbar oscillate. See also `RobustAction`.
        """
        ratio = motion_ratio(vehicle, speed_mps)
        weights = np.array(self.input_weight) * np.maximum(ratio, 1.0) ** 2
        front, trailer, hp = weights.tolist()
        options = super().for_vehicle(vehicle, speed_mps, period_s)
        return replace(options, input_weight=(front, trailer, hp))
