"""Options of the controllers on the articulated error model.

Every field is a key that a scenario may set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Self

from ..mpc.qp import HorizonTuning
from ..reference.corridor import SpeedTube
from ..validation import check_flag
from ..vehicle import Vehicle
from .lq_robust_law import LqRobustTuning

_PERIOD_S: Final = 0.2  # of the paper, for which horizon and weights are given
_ROUNDING: Final = 1e-9


@dataclass(frozen=True)
class MpcOptions(HorizonTuning):
    """Horizon, weights and bounds of an MPC on the articulated error model.

    The outputs are x and y of tractor and trailer in the frames of their references. The horizon
    is four seconds, with six free steps of 0.2 s each. The step weights are low ones that leave a
    margin: with a sixth of that of the front steering worn valves cycle, with a fifth of that of
    the hydrostat it runs into the limit of its rate without a smaller error (docs/ablation.md).

    Horizon and weights are those of a period of 0.2 s and the vehicle of the paper at 1 m/s;
    `for_vehicle` has those of others.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    outputs: ClassVar[int] = 4

    horizon: int = 20  # N_p, predicted periods of 0.2 s
    moves: int = 6  # N_c, free input steps of 0.2 s
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)  # [1/m^2]
    # [1/rad^2], [1/rad^2], for a hydrostat position as a fraction
    step_weight: tuple[float, ...] = (0.3, 0.1, 0.1)
    # [rad], [rad], fraction
    input_bound: tuple[float, ...] = (math.radians(20.0), math.radians(20.0), 0.5)

    def for_vehicle(self, vehicle: Vehicle, speed_mps: float, period_s: float) -> Self:
        """Return the options for a vehicle, the largest speed of its reference and a period.

        - Horizon and free steps span the same time. With n steps in place of one, a ramp of an
          input has the n-th part of its cost and the errors n times theirs, hence the factor n^2
          of all step weights.
        - A step of the hydrostat has the cost of the same change of acceleration
          (`Vehicle.motion_per_input`): a drive of three times the gain cycles at the limit of its
          rate otherwise.
        - The weight of the front steering grows with the square root of the lateral acceleration
          that it causes, from that of the paper's vehicle at 1 m/s on. With its square the error
          of the farm machine at 3.3 m/s grows by half, with none the loop has little margin there.
        """
        steps = _PERIOD_S / period_s
        ratio = vehicle.motion_per_input(speed_mps) / Vehicle().motion_per_input(1.0)
        lateral, _, drive = ratio.tolist()
        front, trailer, hp = (steps**2 * weight for weight in self.step_weight)
        return replace(
            self,
            horizon=math.ceil(steps * self.horizon - _ROUNDING),
            moves=math.ceil(steps * self.moves - _ROUNDING),
            step_weight=(front * math.sqrt(max(lateral, 1.0)), trailer, drive**2 * hp),
        )


@dataclass(frozen=True)
class NominalOptions(MpcOptions):
    """Options of `ttempc-nominal`.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    disturbances: bool = True  # whether the MPC uses the disturbances that the filter estimates
    corridor: bool = True  # whether the MPC keeps to the corridor of the reference, if any
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
        SpeedTube(self.corridor_at_rest_m, self.corridor_per_speed_s)


@dataclass(frozen=True)
class ArticulatedOptions(LqRobustTuning, NominalOptions):
    """Options of `ttempc`: those of its MPC and of its robust law.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    robust: bool = True  # whether the robust law acts

    def __post_init__(self) -> None:
        NominalOptions.__post_init__(self)
        LqRobustTuning.__post_init__(self)
        check_flag("robust", self.robust)
