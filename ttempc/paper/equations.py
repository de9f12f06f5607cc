"""Every place where the printed equations leave a choice, as one dataclass."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args, get_type_hints

from ..errors import InvalidTuning


@dataclass(frozen=True, slots=True)
class PaperEquations:
    """How to read the equations of Kayacan, Ramon and Saeys (2016).

    The numbers are those of docs/errata.md. The defaults are the controller `paper`: as printed,
    with 4, 6 and 7 corrected, for without them it drives nowhere.

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
    # 4: which body's errors the trailer's rows of the error model hold; "tractor" is printed in
    #    eq. (errormodel), "trailer" in the matrix A of eq. (errorstateupdate)
    trailer_error_frame: Literal["trailer", "tractor"] = "trailer"
    # 5: speed of the trailer point, the tractor's (printed) or the exact one
    trailer_speed: Literal["tractor", "exact"] = "tractor"
    # 6: z_m = robust_sign * (zbar_e - z_e); +1 printed, which pushes the vehicle away
    robust_sign: Literal[1, -1] = -1
    # 7: hydrostat position at full stroke in the unit in which K = 1.4 m/s holds; 100 takes
    #    percent at its word, and then the vehicle stands still
    hp_full_scale: Literal[1, 100] = 1
    # 8: the nominal state zbar_e, which is not defined; see `ttempc.laws.robust_law`
    nominal: Literal["one-step", "tube"] = "one-step"

    def __post_init__(self) -> None:
        for name, hint in get_type_hints(type(self)).items():
            value, allowed = getattr(self, name), get_args(hint)
            if value not in allowed:
                raise InvalidTuning(f"equations.{name}: got {value!r}, allowed are {allowed}")
