"""Controllers by name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from types import MappingProxyType
from typing import Any, Final, Literal, TypeVar

from ..baselines.lqr import LqrOptions, lqr_controller
from ..baselines.nmhe import MovingHorizonEstimator
from ..baselines.nmpc import (
    NmpcOptions,
    NmpcRtiOptions,
    nmpc_controller,
    nmpc_decentralised_controller,
    nmpc_distributed_controller,
    nmpc_rti_controller,
)
from ..baselines.paper import (
    PaperOptions,
    PrintedSignOptions,
    paper_controller,
    printed_sign_controller,
)
from ..baselines.pid import PidOptions, pid_controller
from ..errors import InvalidTube, InvalidTuning, UnknownController, UnknownEstimator
from ..estimation.ekf import ExtendedKalmanFilter
from ..estimation.noise import SensorNoise
from ..laws.articulated_mpc import (
    ArticulatedOptions,
    NominalOptions,
    articulated_controller,
    nominal_controller,
)
from ..laws.tracking_controller import NoFeedback, TrackingController, around_exact_feedforward
from ..laws.tube_mpc import TubeMpcOptions, tube_controller
from ..reference.corridor import SpeedTube
from ..reference.reference import Reference
from ..suggestion import did_you_mean
from ..tube.reference_tube import TubeDesign
from ..types import Estimator
from ..vehicle import Vehicle

_Options = TypeVar("_Options")


def parse_options(
    kind: type[_Options], values: Mapping[str, object], where: str = "controller.options"
) -> _Options:
    """Return an instance of the options dataclass `kind` with `values` in place of its defaults.

    Lists become tuples, whole numbers become floats where the default is one. The dataclass
    itself checks types and ranges.

    Raises:
        InvalidTuning: an unknown name, a value of another type, or one out of its range; the
            message names the option below `where` and what is allowed.
    """
    defaults = {
        item.name: item.default
        for item in fields(kind)  # pyright: ignore[reportArgumentType] - a dataclass
    }
    for name in values:
        if name not in defaults:
            raise InvalidTuning(
                f"{where}.{name}: unknown, allowed are {', '.join(defaults)}"
                f"{did_you_mean(name, defaults)}"
            )
    entries = {name: _like(defaults[name], value) for name, value in values.items()}
    try:
        return kind(**entries)
    except InvalidTuning as error:
        raise InvalidTuning(f"{where}.{error}") from None


def _like(default: object, value: object) -> object:
    """Return `value` with lists as tuples, and whole numbers as floats where `default` has them."""
    if isinstance(default, tuple) and isinstance(value, list | tuple):
        return tuple(_like(default[0], entry) for entry in value)
    return float(value) if isinstance(default, float) and type(value) is int else value


def feedforward_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose the exact feedforward alone: what the reference asks for, whatever happens."""
    return around_exact_feedforward(
        vehicle, reference, period_s, 1, lambda grid, feedforward: NoFeedback()
    )


@dataclass(frozen=True, slots=True)
class ControllerEntry:
    """A controller that users choose by name."""

    about: str  # one line for `ttempc list`
    # (vehicle, reference, period [s]) -> TrackingController; `options` and `design` as keywords
    make: Callable[..., TrackingController]
    options: type | None = None  # dataclass of its options; None where it has none
    # Whether it needs the design of a tube, or uses one where one is given: is tightened by it, and
    # monitors its place in it.
    tube: Literal["required", "optional"] | None = None


CONTROLLERS: Final = MappingProxyType(
    {
        "ttempc": ControllerEntry(
            "articulated model: exact feedforward, offset-free MPC in a growing tube, robust law",
            articulated_controller,
            ArticulatedOptions,
            tube="optional",
        ),
        "ttempc-nominal": ControllerEntry(
            "ttempc without its robust law", nominal_controller, NominalOptions
        ),
        "ttempc-tube": ControllerEntry(
            "tube MPC: nominal vehicle, tightened limits, a gain that keeps to a measured tube",
            tube_controller,
            TubeMpcOptions,
            tube="required",
        ),
        "paper": ControllerEntry(
            "the paper's equations as printed, errata 4, 6 and 7 corrected",
            paper_controller,
            PaperOptions,
        ),
        "paper-printed-sign": ControllerEntry(
            "the same with erratum 6 as printed and a tube's nominal state: the vehicle is lost",
            printed_sign_controller,
            PrintedSignOptions,
        ),
        "pid": ControllerEntry(
            "conventional guidance: a PID loop for each input", pid_controller, PidOptions
        ),
        "lqr": ControllerEntry(
            "LQR on the articulated model and the filter's disturbances",
            lqr_controller,
            LqrOptions,
        ),
        "nmpc": ControllerEntry(
            "nonlinear MPC, converged: horizon, weights, bounds of the linear one",
            nmpc_controller,
            NmpcOptions,
        ),
        "nmpc-rti": ControllerEntry(
            "the same with one Gauss-Newton iteration a period",
            nmpc_rti_controller,
            NmpcRtiOptions,
        ),
        "nmpc-decentralised": ControllerEntry(
            "tractor and trailer each with an NMPC, the other's inputs held",
            nmpc_decentralised_controller,
            NmpcOptions,
        ),
        "nmpc-distributed": ControllerEntry(
            "the same, plans exchanged once a period",
            nmpc_distributed_controller,
            NmpcOptions,
        ),
        "feedforward": ControllerEntry(
            "inputs of the exact reference geometry, no feedback", feedforward_controller
        ),
    }
)


def controller_entry(name: str) -> ControllerEntry:
    """Return the entry of the controller called `name`.

    Raises:
        UnknownController: with the names that exist.
    """
    if name not in CONTROLLERS:
        raise UnknownController(
            f"controller {name!r} does not exist; allowed are {', '.join(sorted(CONTROLLERS))}"
            f"{did_you_mean(name, CONTROLLERS)}"
        )
    return CONTROLLERS[name]


def controller_options(name: str, values: Mapping[str, object]) -> dict[str, object]:
    """Return all options of the controller called `name`, defaults in the place of absent ones.

    Raises:
        UnknownController: with the names that exist.
        InvalidTuning: an option is unknown, of another type, or out of its range.
    """
    options = _options(name, values)
    return {} if options is None else asdict(options)


def speed_tube(name: str, values: Mapping[str, object]) -> SpeedTube | None:
    """Return the half widths over speed of the controller called `name`, None where it has none.

    Raises:
        UnknownController, InvalidTuning: as `controller_options`.
    """
    options = _options(name, values)
    return options.speed_tube if isinstance(options, NominalOptions) else None


def make_controller(
    name: str,
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    design: TubeDesign | None = None,
    options: Mapping[str, object] | None = None,
) -> TrackingController:
    """Return the controller called `name`.

    Args:
        name: one of `CONTROLLERS`.
        vehicle: model parameters.
        reference: what to follow.
        period_s: control period [s].
        design: the tube of controllers that need or use one; others ignore it.
        options: values in the place of the defaults of its options.

    Raises:
        UnknownController: with the names that exist.
        InvalidTuning: an option is unknown, of another type, or out of its range.
        InvalidTube: there is no design, or it does not fit vehicle and reference.

    Examples:
        >>> from ttempc import ConstantSpeed, figure_eight
        >>> vehicle = Vehicle()
        >>> reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
        >>> controller = make_controller("ttempc", vehicle, reference, 0.2, options={"horizon": 15})
        >>> sorted(CONTROLLERS)[:3]
        ['feedforward', 'lqr', 'nmpc']
    """
    entry = controller_entry(name)
    if entry.tube == "required" and design is None:
        raise InvalidTube(f"controller {name!r}: needs the design of a tube")
    keywords: dict[str, object] = {}
    if (chosen := _options(name, options or {})) is not None:
        keywords["options"] = chosen
    if entry.tube is not None and design is not None:
        keywords["design"] = design
    return entry.make(vehicle, reference, period_s, **keywords)


def _options(name: str, values: Mapping[str, object]) -> Any:  # noqa: ANN401 - a dataclass
    entry = controller_entry(name)
    if entry.options is not None:
        return parse_options(entry.options, values)
    if values:
        raise InvalidTuning(
            f"controller.options: the controller {name!r} has none, got {', '.join(values)}"
        )
    return None


EstimatorFactory = Callable[[Vehicle, SensorNoise], Estimator]
"""Makes an estimator from the model parameters and the assumed sensor noise."""

ESTIMATORS: Final = MappingProxyType[str, EstimatorFactory](
    {
        "ekf": ExtendedKalmanFilter,
        "nmhe": MovingHorizonEstimator,
    }
)


def estimator_factory(name: str) -> EstimatorFactory:
    """Return the factory of the estimator called `name`.

    Raises:
        UnknownEstimator: with the names that exist.
    """
    if name not in ESTIMATORS:
        raise UnknownEstimator(
            f"estimator {name!r} does not exist; allowed are {', '.join(sorted(ESTIMATORS))}"
            f"{did_you_mean(name, ESTIMATORS)}"
        )
    return ESTIMATORS[name]
