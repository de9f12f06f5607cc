"""Controllers and estimators by name, with their options; modules are loaded when asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, fields
from importlib import import_module
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

from ..errors import (
    InvalidTube,
    InvalidTuning,
    TtempcError,
    UnknownController,
    UnknownEstimator,
)
from ..suggestion import did_you_mean
from ..types import Estimator

if TYPE_CHECKING:
    from ..estimation.noise import SensorNoise
    from ..laws.tracking_controller import TrackingController
    from ..reference.corridor import SpeedTube
    from ..reference.reference import Reference
    from ..tube.reference_tube import TubeDesign
    from ..tuning import SearchRange
    from ..vehicle import Vehicle

_Options = TypeVar("_Options")


def _load(place: str, name: str) -> Any:  # noqa: ANN401 - a factory or a type
    return getattr(import_module(f"ttempc.{place}"), name)


@dataclass(frozen=True, slots=True)
class ControllerEntry:
    """A controller that users choose by name."""

    about: str  # one line for `ttempc list`
    # Module below `ttempc`, the factory in it (vehicle, reference, period [s], keywords `options`
    # and `design`) and, where there are any, the dataclass of its options
    place: str
    # Whether it needs the design of a tube, or uses one where one is given: is tightened by it, and
    # monitors its place in it.
    tube: Literal["required", "optional"] | None = None
    foresees: bool = False  # whether it foresees by default, see `GuidanceSettings.foresee`

    @property
    def options(self) -> Any:  # noqa: ANN401 - a dataclass
        """Dataclass of the options, None where there are none."""
        module, _, *name = self.place.split()
        return _load(module, *name) if name else None

    @property
    def search_space(self) -> tuple[SearchRange, ...]:
        """Ranges of the options that are searched when it is tuned; none where there are none."""
        return getattr(self.options, "search_space", ())


CONTROLLERS: Final = MappingProxyType(
    {
        "ttempc": ControllerEntry(
            "articulated model: exact feedforward, offset-free MPC in a growing tube, robust law",
            "laws.articulated_mpc articulated_controller ArticulatedOptions",
            tube="optional",
            foresees=True,
        ),
        "ttempc-nominal": ControllerEntry(
            "ttempc without its robust law and its tube",
            "laws.articulated_mpc articulated_controller NominalOptions",
            foresees=True,
        ),
        "ttempc-tube": ControllerEntry(
            "tube MPC: nominal vehicle, tightened limits, a gain that keeps to a measured tube",
            "laws.tube_mpc tube_controller MpcOptions",
            tube="required",
        ),
        "paper": ControllerEntry(
            "the paper's equations, in the reading that agrees best with its own observations",
            "baselines.paper paper_controller PaperOptions",
        ),
        "paper-rate-weight": ControllerEntry(
            "the same with steering in rad/s in the cost: nearest to the published errors, weaves",
            "baselines.paper paper_controller RateWeightOptions",
        ),
        "paper-tube": ControllerEntry(
            "the same with the nominal system of a tube MPC, on which the MPC acts",
            "baselines.paper paper_controller TubeOptions",
        ),
        "paper-subtracted": ControllerEntry(
            "the same with the measured hitch angle subtracted: the trailer steers to its stop",
            "baselines.paper paper_controller SubtractedOptions",
        ),
        "paper-printed-sign": ControllerEntry(
            "paper with the sign of the robust action as printed: the vehicle is lost",
            "baselines.paper paper_controller PrintedSignOptions",
        ),
        "pid": ControllerEntry(
            "conventional guidance: a PID loop for each input",
            "baselines.pid pid_controller PidOptions",
        ),
        "lqr": ControllerEntry(
            "LQR on the articulated model and the filter's disturbances",
            "baselines.lqr lqr_controller LqrOptions",
        ),
        "nmpc": ControllerEntry(
            "nonlinear MPC, converged: horizon, weights, bounds of the linear one",
            "baselines.nmpc nmpc_controller NmpcOptions",
        ),
        "nmpc-rti": ControllerEntry(
            "the same with one Gauss-Newton iteration a period",
            "baselines.nmpc nmpc_controller NmpcRtiOptions",
        ),
        "nmpc-decentralised": ControllerEntry(
            "nmpc as a problem of the tractor and one of the trailer, which exchange nothing",
            "baselines.nmpc nmpc_decentralised_controller NmpcOptions",
        ),
        "nmpc-distributed": ControllerEntry(
            "the same with the tractor's plan known to the trailer",
            "baselines.nmpc nmpc_distributed_controller NmpcOptions",
        ),
        "nmpc-path": ControllerEntry(
            "the published NMPC: printed model, path-parametrised; with the estimator nmhe-printed",
            "baselines.nmpc_path nmpc_path_controller NmpcPathOptions",
        ),
        "romea-backstepping": ControllerEntry(
            "INRAE's Romea: back-stepping on deviation and course with side slip, speed as pid",
            "baselines.romea backstepping_controller BackSteppingOptions",
        ),
        "romea-predictive": ControllerEntry(
            "INRAE's Romea: chained form with side slip, curvature predicted over the valve's lag",
            "baselines.romea predictive_controller PredictiveOptions",
        ),
        "feedforward": ControllerEntry(
            "inputs of the exact reference geometry, no feedback",
            "laws.tracking_controller feedforward_controller",
        ),
    }
)

EstimatorFactory = Callable[["Vehicle", "SensorNoise"], Estimator]
"""Makes an estimator from the model parameters and the assumed sensor noise."""


ESTIMATORS: Final = MappingProxyType(
    {
        "ekf": "estimation.ekf ExtendedKalmanFilter",
        "nmhe": "estimation.nmhe MovingHorizonEstimator",
        "nmhe-printed": "estimation.nmhe PrintedEstimator",
    }
)


def _known(kind: str, name: str, known: Mapping[str, Any], error: type[TtempcError]) -> Any:  # noqa: ANN401 - an entry
    if name not in known:
        raise error(
            f"{kind} {name!r} does not exist; allowed are {', '.join(sorted(known))}"
            f"{did_you_mean(name, known)}"
        )
    return known[name]


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
    return getattr(_options(name, values), "speed_tube", None)


def make_controller(
    name: str,
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    design: TubeDesign | None = None,
    options: Mapping[str, object] | None = None,
) -> TrackingController:
    """Return the controller called `name`; one that uses no tube ignores the `design`.

    Raises:
        UnknownController: with the names that exist.
        InvalidTuning: an option is unknown, of another type, or out of its range.
        InvalidTube: there is no design, or it does not fit vehicle and reference.

    Examples:
        >>> from ttempc import ConstantSpeed, Reference, figure_eight
        >>> vehicle = Vehicle()
        >>> reference = Reference(figure_eight(), vehicle, ConstantSpeed(1.0))
        >>> controller = make_controller("ttempc", vehicle, reference, 0.2, options={"horizon": 15})
        >>> sorted(CONTROLLERS)[:3]
        ['feedforward', 'lqr', 'nmpc']
    """
    entry: ControllerEntry = _known("controller", name, CONTROLLERS, UnknownController)
    if entry.tube == "required" and design is None:
        raise InvalidTube(f"controller {name!r}: needs the design of a tube")
    keywords: dict[str, object] = {}
    if (chosen := _options(name, options or {})) is not None:
        keywords["options"] = chosen
    if entry.tube is not None and design is not None:
        keywords["design"] = design
    return _load(*entry.place.split()[:2])(vehicle, reference, period_s, **keywords)


def _options(name: str, values: Mapping[str, object]) -> Any:  # noqa: ANN401 - a dataclass
    kind = _known("controller", name, CONTROLLERS, UnknownController).options
    if kind is not None:
        return parse_options(kind, values)
    if values:
        raise InvalidTuning(
            f"controller.options: the controller {name!r} has none, got {', '.join(values)}"
        )
    return None


def estimator_factory(name: str) -> EstimatorFactory:
    """Return the factory of the estimator called `name`.

    Raises:
        UnknownEstimator: with the names that exist.
    """
    return _load(*_known("estimator", name, ESTIMATORS, UnknownEstimator).split())


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
