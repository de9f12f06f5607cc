"""Settings of a guidance beside its vehicle, reference, controller and estimator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..detectors.monitors import Detect
from ..estimation.noise import SensorNoise
from ..learning.learner import Identifier
from ..types import FloatArray
from .safety import SafetyLimits

if TYPE_CHECKING:
    from ..tube.reference_tube import TubeDesign


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GuidanceSettings:
    """Settings of a `Guidance`; printed, it shows all of them.

    Examples:
        >>> GuidanceSettings(learn=False).speed_mps
        1.0
    """

    options: Mapping[str, object] = field(default_factory=dict)
    """Keyword options of the controller by name or factory, such as `horizon`."""

    sensor_noise: SensorNoise = field(default_factory=SensorNoise)
    """Standard deviations that the estimator assumes."""

    tube: TubeDesign | None = None
    """Tube of controllers that need or use one; without it `ttempc` tightens nothing."""

    safety: SafetyLimits = field(default_factory=SafetyLimits)
    """Where the supervisor slows down and stops."""

    speed_mps: float = 1.0
    """Speed along a `Path` [m/s]; a `Reference` has its own."""

    learn: bool | Sequence[Identifier] = True
    """Whether dead times, lags and lengths are learnt; or identifiers of your own."""

    learn_field: bool | FloatArray = False
    """Whether disturbances are learnt by place and known on the next pass over the same line; or
    the `FieldMap.rows` of an earlier drive."""

    foresee: bool | None = None
    """Whether the side slip of the trailer is foretold from what its tractor has met at a place,
    see `ttempc.learning.foresight`; absent: for `ttempc` and `ttempc-nominal`."""

    detect: Detect = True
    """Whether the built-in detectors of faults run; or a list of the names of those that run, of
    those that do not (`"-drift"`), and of detectors of your own beside them."""

    compensate: bool = True
    """Whether dead times are compensated around a controller by name or factory, see
    `DeadTimeCompensation`; the estimator knows them."""
