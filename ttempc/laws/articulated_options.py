"""Options of the controllers on the articulated error model.

Every field is a key that a scenario may set.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ..mpc.qp import HorizonTuning
from ..validation import check_flag
from .lq_robust_law import LqRobustTuning


@dataclass(frozen=True)
class MpcOptions(HorizonTuning):
    """Horizon, weights and bounds of an MPC on the articulated error model.

    The outputs are x and y of tractor and trailer in the frames of their references. The horizon
    is four seconds at a period of 0.2 s, with six free steps. The hydrostat, which lags by two
    seconds, moves freely: this takes a tenth to a fourth off the error along the path wherever the
    ground changes. Steering does not: with a twentieth of its weights the error on a wet slope
    falls by another tenth, and worn valves cycle at twice the error (docs/ablation.md).

    Raises:
        InvalidTuning: a value is out of its range.
    """

    outputs: ClassVar[int] = 4

    horizon: int = 20  # N_p, predicted periods
    moves: int = 6  # N_c, free input steps
    output_weight: tuple[float, ...] = (1.0, 1.0, 1.0, 1.0)  # [1/m^2]
    # [1/rad^2], [1/rad^2], for a hydrostat position as a fraction
    step_weight: tuple[float, ...] = (1.0, 1.0, 0.02)
    # [rad], [rad], fraction
    input_bound: tuple[float, ...] = (math.radians(20.0), math.radians(20.0), 0.5)


@dataclass(frozen=True)
class NominalOptions(MpcOptions):
    """Options of `ttempc-nominal`.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    disturbances: bool = True  # whether the MPC uses the disturbances that the filter estimates

    def __post_init__(self) -> None:
        MpcOptions.__post_init__(self)
        check_flag("disturbances", self.disturbances)


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
