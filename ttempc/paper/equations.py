"""Readings of the printed equations where they leave a choice."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args, get_type_hints

from ..laws.nominal_state import Reading
from ..validation import check_choice


@dataclass(frozen=True)
class PaperEquations:
    """Reading of the equations of Kayacan, Ramon and Saeys (2016).

    The numbers are those of docs/errata.md. The defaults are those of the controller `paper`: as
    printed, with 4, 6 and 7 corrected, without which the vehicle stands still or is lost.

    Raises:
        InvalidTuning: a value is not one of the allowed ones.
    """

    # 1: sign of the hitch term in the trailer's yaw equation; +1 printed, -1 geometry
    hitch_sign: Literal[1, -1] = 1
    # 2: delta_i = lambda - beta with the hitch angle as measured (printed), so that the loop is
    #    closed through beta, or with the reference's
    hitch_angle: Literal["measured", "reference"] = "measured"
    # 3: steering feedforward by eq. (ffcontrolaction), or from the exact posture on the path
    feedforward: Literal["printed", "geometry"] = "printed"
    # 4: body whose errors stand in the trailer's rows of the error model; "tractor" is printed in
    #    eq. (errormodel), "trailer" in the matrix A of eq. (errorstateupdate)
    trailer_error_frame: Literal["trailer", "tractor"] = "trailer"
    # 5: speed of the trailer point, the tractor's (printed) or the exact one
    trailer_speed: Literal["tractor", "exact"] = "tractor"
    # 6: z_m = robust_sign * (zbar_e - z_e); +1 printed, which pushes the vehicle away
    robust_sign: Literal[1, -1] = -1
    # 7: hydrostat position at full stroke in the unit in which K = 1.4 m/s holds; with 100, the
    #    printed percent, the vehicle stands still
    hp_full_scale: Literal[1, 100] = 1
    # 8: the nominal state zbar_e, which is not defined; see `ttempc.laws.nominal_state`
    nominal: Reading = "one-step"

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(PaperEquations).items():
            check_choice(name, getattr(self, name), get_args(hint))
