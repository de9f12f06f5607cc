"""Options of the paper's controller.

Every field is a key that a scenario may set.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ..laws.nominal_state import Reading
from ..mpc.qp import HorizonTuning
from ..validation import check_flag
from .equations import PaperEquations
from .robust_law import RobustGains


@dataclass(frozen=True)
class PaperOptions(PaperEquations, RobustGains, HorizonTuning):
    """Options of `paper`: horizon, weights and bounds, gains, and the reading of the equations.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    robust: bool = True  # whether the robust law acts

    def __post_init__(self) -> None:
        HorizonTuning.__post_init__(self)
        RobustGains.__post_init__(self)
        PaperEquations.__post_init__(self)
        check_flag("robust", self.robust)


@dataclass(frozen=True)
class PrintedSignOptions(PaperOptions):
    """Options of `paper-printed-sign`: the sign of the robust action as printed (erratum 6).

    The nominal state is the tube's own. In the one-step reading the modelling error does not depend
    on where the vehicle is, and its sign has next to no effect.

    Raises:
        InvalidTuning: a value is out of its range.
    """

    robust_sign: Literal[1, -1] = 1
    nominal: Reading = "tube"
