"""Traction, motion resistance and side force of a wheel on soil: equations and coefficients.

Sources: [B] W. W. Brixius, "Traction prediction equations for bias ply tires", ASAE paper 87-1622,
1987, also in ASABE D497; [G] D. Gee-Clough and M. S. Sommer, "Steering forces on undriven, angled
wheels", J. Terramechanics 18, 1981, with the mobility number of the US Army's Waterways Experiment
Station. [B] is quoted from secondary sources, [G] from memory: neither primary source was read. The
coefficients of [G], and those for radial tyres, are also in the public MAVS simulator
(`vti/brixius.cpp`), whose mobility number for side force has a dimension and is not used. [P]
H. B. Pacejka, "Tire and Vehicle Dynamics", 3rd ed., 2012, sec. 4.2: similarity of slips; relaxation
length = cornering stiffness over lateral stiffness of the tyre, chap. 1 and 5. [S] H. Schwanghart,
"Lateral forces on steered tyres in loose soil", J. Terramechanics 5, 1968, and G. Ishigami et al.,
"Terramechanics-based model for steering maneuver of planetary exploration rovers on loose soil",
J. Field Robotics 24, 2007, both from memory: side force of a sunk wheel = shear under it + passive
resistance of the soil beside it. [R] G. Rill, "Road Vehicle Dynamics", CRC Press, 2012, chap. 3,
bore torque of TMeasy, from memory, and as Project Chrono has it: one vector of all three slips.
"""

from copy import copy
from dataclasses import fields
from types import MappingProxyType
from typing import Annotated, Any, Final, Literal, Self

import numpy as np
from pydantic import AfterValidator, Field, model_validator
from pydantic.dataclasses import dataclass
from pydantic_core import ArgsKwargs

from ttempc.types import FloatArray

from ..configuration.config_io import STRICT, NotNegative, Positive

# Explicit in the speed, so that a short length with a long time would be unstable at 4 ms.
_SHORTEST_M: Final = 0.0005
_Length = Annotated[float, Field(ge=_SHORTEST_M, le=10.0)]
_Damping = Annotated[float, Field(ge=0.0, le=0.1)]


def _none_or_length(value: float) -> float:
    if 0.0 < value < _SHORTEST_M:
        raise ValueError(f"must be 0 or at least {_SHORTEST_M:g} m")
    return value


RADIAL: Final = MappingProxyType(
    {
        "traction_slip": 10.5,
        "resistance_tyre": 0.0325,
        "resistance_bn": 0.9,
        "side": 0.8,
        "side_mobility": 0.0,
        "side_stiffness_per_rad": 2.79,
        "side_stiffness_mobility_per_rad": 0.16,
        "carcass_lat": 0.45,
    }
)
"""Coefficients of radial tyres that differ from those of bias-ply tyres (MAVS; the last assumed).
"""


@dataclass(frozen=True, kw_only=True, config=STRICT)
class SoilLaw:
    """Coefficients of the law; the default values are those of bias-ply tyres.

    With width b, diameter d, section height h, deflection delta at the rated load, load W, cone
    index CI, slip s and slip angle alpha, all but the lengths and times without a dimension:

        Cn = CI b d / W
        Bn = Cn (1 + mobility_deflection delta / h) / (1 + mobility_width b / d)            [B]
        M = Cn sqrt(delta / h) / (1 + mobility_side_width b / d)                            [G]
        traction ratio        traction (1 - e^(-traction_bn Bn)) (1 - e^(-traction_slip s)) [B]
        resistance of soil    resistance_bn / Bn + resistance_slip s / sqrt(Bn)             [B]
        resistance of tyre    resistance_tyre                                               [B]
        side force ratio      mu (1 - e^(-C / mu |alpha|))                                  [G]
        mu                    min(side + side_mobility / M, side_most, bearing)
        bearing               side_bearing x largest traction ratio
        C                     min(side_stiffness + side_stiffness_mobility M, side_stiffness_most)

    The resistance of the soil acts on the hub, that of the tyre is a torque on the wheel against
    its rolling. A driven wheel then has the torque and the net pull of [B], in which the 0.04 of
    the gross traction ratio cancels that of the motion resistance ratio. A wheel without torque
    skids until its traction is minus the resistance of the tyre; its hub is held back by the whole
    motion resistance ratio of [B]. The tyre's torque only takes energy: the law is passive.

    A slip along the wheel takes side force away, see `combined_ratios`: all of that which the soil
    under the tyre bears by shear, none of that which the soil beside a sunk tyre bears,

        share beside the tyre   1 - e^(-(side_beside_bn / Bn)^2).                           [S]

    [G] measured undriven wheels; over which M is not known here. Its mu grows without bound as soil
    softens, which soil cannot bear: it shears where the stress reaches c + sigma tan(phi)
    (Coulomb), whatever the direction, and the largest traction ratio is what [B] measured of it
    under the tyre. The stiffness would grow without bound on firm ground, where the carcass
    limits it.

    Side force follows the slip angle over the relaxation length [P]

        sigma = max(a, C delta / carcass_lat),    a = sqrt(delta (2 r - delta)),

    with delta the deflection of the tyre under its load and a half the length of its contact: the
    cornering stiffness C W over the lateral stiffness carcass_lat W / delta, and not less than the
    contact of a stiff carcass needs. A model, not measured: no length of an agricultural tyre was
    found in numbers.

    A wheel that turns about the normal of the ground bores into it: the contact is a ring that
    slides at bore_radius x rate of turn, with the stiffness, the limit and the relaxation length
    of side slip [R],

        bore_radius = bore x 2/3 R,    R = (a + b / 2) / 2,
        moment = bore_radius W mu (1 - e^(-C / mu |s|)),    s = bore_radius rate / speed,

    with R the radius of a disc in place of the contact, 2 a long and b wide; 2/3 R mu W is the
    moment of a disc of even pressure that slides everywhere. In rolling, slip, slip angle and s are
    one vector, see `combined_ratios`; at rest it is a spring, C W bore_radius^2 / sigma. The moment
    of a side force about the middle of the contact (pneumatic trail) is left out.
    """

    tyre: Literal["by-size", "bias", "radial"] = "by-size"
    """Kind of tyre whose coefficients the absent keys of this table take; by size, those tyres are
    radial that have an R before the rim, as 16.9R34."""
    mobility_deflection: NotNegative = 5.0
    """Weight of the relative deflection in Bn."""
    mobility_width: NotNegative = 3.0
    """Weight of width over diameter in Bn."""
    mobility_side_width: NotNegative = 0.5
    """Weight of width over diameter in M."""
    traction: Positive = 0.88
    """Limit of the traction ratio at full slip on firm soil."""
    traction_bn: Positive = 0.1
    """Growth of the traction ratio with Bn."""
    traction_slip: Positive = 7.5
    """Growth of the traction ratio with slip."""
    resistance_tyre: NotNegative = 0.04
    """Motion resistance of the tyre over the load, on any ground."""
    resistance_bn: NotNegative = 1.0
    """Motion resistance of the soil over the load, times Bn."""
    resistance_slip: NotNegative = 0.5
    """Growth of the motion resistance with slip, times the root of Bn."""
    side: Positive = 0.61
    """Limit of the side force ratio on firm soil."""
    side_mobility: NotNegative = 0.69
    """Growth of that limit with 1 / M."""
    side_most: Positive = 0.88
    """Largest limit of the side force ratio; that of traction on firm soil (assumed)."""
    side_bearing: Positive = 1.0
    """Largest limit of the side force ratio over that of traction: what the soil bears."""
    side_stiffness_per_rad: Positive = 2.34
    """Initial slope of the side force ratio at M = 0."""
    side_stiffness_mobility_per_rad: NotNegative = 0.088
    """Growth of that slope with M."""
    side_stiffness_most_per_rad: Positive = 6.0
    """Largest slope; 0.1 per degree, the order of tractor tyres on concrete (assumed)."""
    side_beside_bn: NotNegative = 15.0
    """Bn at which the soil beside the tyre bears 63 % of the side force; 0: none. Fitted to
    a grousered wheel on sand at 15 deg (3D-RFT-wheel), taken as Bn = 20; the square is that of
    passive resistance, which grows with the square of the sinkage."""
    relaxation_long_m: _Length = 0.15
    """Relaxation length of slip; assumed."""
    relaxation_lat_m: Annotated[float, Field(ge=0.0, le=10.0), AfterValidator(_none_or_length)] = (
        0.0
    )
    """Relaxation length of side slip of all tyres; 0: by tyre, load and soil."""
    carcass_lat: Positive = 0.55
    """Lateral over vertical stiffness of the tyre; assumed, 0.4 to 0.7."""
    relaxation_roll_m: _Length = 0.001
    """Distance over which motion resistance changes its sign; assumed."""
    damping_long_s: _Damping = 0.01
    """Damping over stiffness of the tread along the wheel; assumed."""
    damping_lat_s: _Damping = 0.02
    """Damping over stiffness of the tread across the wheel; assumed."""
    damping_roll_s: _Damping = 0.06
    """Damping over stiffness of motion resistance at rest: a vehicle stops without swing; assumed.
    """
    bore: NotNegative = 0.0
    """Radius of the ring that bores over that of [R]; 1: [R], 0: a wheel turns freely on the spot.
    """

    @model_validator(mode="before")
    @classmethod
    def _fill_in(cls, data: Any) -> Any:  # noqa: ANN401 - whatever stands in the file
        """Add the coefficients of the kind of tyre where the data do not give them."""
        given = data.kwargs or {} if isinstance(data, ArgsKwargs) else data
        if not isinstance(given, dict) or given.get("tyre") != "radial":
            return data
        return {**RADIAL, **given}

    def of(self, radial: np.ndarray) -> Self:
        """Return the law of tyres that are radial or not, (n,), its coefficients (n,) or floats.

        By size, a radial tyre has its own value where this table has that of bias-ply tyres.
        """
        if self.tyre != "by-size" or not np.any(radial):
            return self
        law = copy(self)
        for name, value in RADIAL.items():
            given = getattr(self, name)
            if np.all(given == getattr(SoilLaw, name)):
                object.__setattr__(law, name, np.where(radial, value, given))
        return law

    def table(self, count: int) -> FloatArray:
        """Return the coefficients of `count` wheels for the compiled law, rows `SOIL`."""
        coefficients = [np.broadcast_to(getattr(self, name), count) for name in _NUMBERS]
        return np.column_stack(coefficients)

    def largest_traction_ratio(self, bn: FloatArray) -> FloatArray:
        """Return the traction ratio at full slip, (n,)."""
        return self.traction * (1.0 - np.exp(-self.traction_bn * bn))

    def traction_ratio(self, bn: FloatArray, slip: FloatArray) -> FloatArray:
        """Return the force of the soil along the wheel over load, odd in the slip, (n,)."""
        developed = 1.0 - np.exp(-self.traction_slip * np.abs(slip))
        return np.sign(slip) * self.largest_traction_ratio(bn) * developed

    def slip_at_traction(self, bn: FloatArray, ratio: FloatArray | float) -> FloatArray:
        """Return the slip of a traction ratio; inverts `traction_ratio`.

        A ratio beyond the largest one counts as 0.999 of it.
        """
        share = np.clip(ratio / self.largest_traction_ratio(bn), -0.999, 0.999)
        return -np.sign(share) * np.log(1.0 - np.abs(share)) / self.traction_slip

    def towed_slip(self, bn: FloatArray) -> FloatArray:
        """Return the slip of a wheel that rolls forward without torque; below 0, (n,)."""
        return self.slip_at_traction(bn, -self.resistance_tyre)

    def gross_traction_ratio(self, bn: FloatArray, slip: FloatArray) -> FloatArray:
        """Return the torque of a wheel that rolls forward, over load and radius, (n,). [B]"""
        return self.traction_ratio(bn, slip) + self.resistance_tyre

    def soil_resistance_ratio(self, bn: FloatArray, slip: FloatArray) -> FloatArray:
        """Return the resistance of the soil over load, (n,); the slip is that of a driven wheel.

        [B] has the growth with slip for driven wheels. A wheel that skids, slip below 0, has none.
        """
        growth = self.resistance_slip * np.maximum(slip, 0.0) / np.sqrt(bn)
        return self.resistance_bn / bn + growth

    def motion_resistance_ratio(self, bn: FloatArray, slip: FloatArray) -> FloatArray:
        """Return the resistance of soil and tyre over load, (n,). [B]"""
        return self.soil_resistance_ratio(bn, slip) + self.resistance_tyre

    def net_traction_ratio(self, bn: FloatArray, slip: FloatArray) -> FloatArray:
        """Return gross traction less motion resistance: the pull of the hub over load, (n,). [B]"""
        return self.traction_ratio(bn, slip) - self.soil_resistance_ratio(bn, slip)

    def largest_side_ratio(self, bn: FloatArray, mobility: FloatArray) -> FloatArray:
        """Return mu, the limit of side force over load at large slip angles, (n,)."""
        side_limit = np.minimum(self.side_most, self.side_bearing * self.largest_traction_ratio(bn))
        return np.minimum(self.side + self.side_mobility / mobility, side_limit)

    def side_stiffness(self, mobility: FloatArray) -> FloatArray:
        """Return C, the initial slope of side force over load [1/rad], (n,)."""
        growth = self.side_stiffness_mobility_per_rad * mobility
        return np.minimum(self.side_stiffness_per_rad + growth, self.side_stiffness_most_per_rad)

    def combined_ratios(
        self,
        bn: FloatArray,
        mobility: FloatArray,
        slip: FloatArray | float,
        slip_angle: FloatArray,
        bore_slip: FloatArray | float = 0.0,
    ) -> tuple[FloatArray, FloatArray]:
        """Return traction and side force over load, both (n,), at slip and slip angle [rad].

        Under the tyre similarity holds after [P]: slip, slip angle and bore slip, each over the
        value at which its initial slope reaches its limit, are one vector,

            x = traction_slip s,   y = C / mu alpha,   z = C / mu s_bore,   rho = |(x, y, z)|.

        Both pure curves are 1 - e^-rho of their limit; the force has this size along the vector.
        The soil beside a sunk tyre bears a share b of the side force whatever the slip [S]:

            traction = largest (1 - e^-rho) x / rho,
            side = -mu ((1 - b) (1 - e^-rho) y / rho + b (1 - e^-|y|) y / |y|).

        Pure slip gives the pure laws; each force stays within its own limit, and where the soil
        beside bears nothing both stay in their ellipse.
        """
        largest = self.largest_side_ratio(bn, mobility)
        x = self.traction_slip * np.asarray(slip)
        y = self.side_stiffness(mobility) / largest * slip_angle
        z = self.side_stiffness(mobility) / largest * np.asarray(bore_slip)
        rho = np.sqrt(x**2 + y**2 + z**2)
        share = np.where(rho > 0.0, -np.expm1(-rho) / np.where(rho > 0.0, rho, 1.0), 1.0)
        beside = self.share_beside(bn)
        side = (1.0 - beside) * share * y - beside * np.sign(y) * np.expm1(-np.abs(y))
        return self.largest_traction_ratio(bn) * share * x, -largest * side

    def share_beside(self, bn: FloatArray) -> FloatArray:
        """Return the share of the side force that the soil beside the tyre bears, (n,). [S]"""
        return -np.expm1(-((self.side_beside_bn / bn) ** 2))


_NUMBERS: Final = tuple(each.name for each in fields(SoilLaw) if each.name != "tyre")

SOIL: Final = np.dtype([(name, np.float64) for name in _NUMBERS])
"""Coefficients of one wheel, a row of `SoilLaw.table`."""
