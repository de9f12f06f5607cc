"""The controllers by name, as compositions u = u_f - u_b + u_m."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

from ..baselines.lqr import lqr_controller
from ..baselines.nmpc import (
    nmpc_controller,
    nmpc_decentralised_controller,
    nmpc_distributed_controller,
    nmpc_rti_controller,
)
from ..baselines.pid import pid_controller
from ..errors import InvalidTube, UnknownController
from ..laws.articulated_mpc import articulated_controller, nominal_controller
from ..laws.tracking_controller import NoFeedback, TrackingController, around_exact_feedforward
from ..laws.tube_mpc import tube_controller
from ..paper.composition import paper_controller, printed_sign_controller
from ..reference.reference import Reference
from ..tube.reference_tube import TubeDesign
from ..types import Controller
from ..vehicle import Vehicle


def feedforward_controller(
    vehicle: Vehicle, reference: Reference, period_s: float
) -> TrackingController:
    """Compose the exact feedforward alone: what the reference asks for, whatever happens."""
    return around_exact_feedforward(
        vehicle, reference, period_s, 1, lambda grid, feedforward: NoFeedback()
    )


@dataclass(frozen=True, slots=True)
class Composition:
    """A controller that users can ask for by name."""

    about: str
    make: Callable[..., Controller]  # of vehicle, reference, period [s], and design if it takes one
    # Whether it keeps to a tube, which it cannot do without, or watches where it is in one.
    tube: Literal["keeps", "watches"] | None = None


CONTROLLERS = MappingProxyType(
    {
        "ttempc": Composition(
            "articulated model: exact feedforward, offset-free linear MPC, saturated robust law",
            articulated_controller,
            tube="watches",
        ),
        "ttempc-nominal": Composition("ttempc without its robust law", nominal_controller),
        "ttempc-tube": Composition(
            "tube MPC: nominal vehicle, tightened limits, a gain that keeps to a measured tube",
            tube_controller,
            tube="keeps",
        ),
        "paper": Composition(
            "the paper's equations as printed, errata 4, 6 and 7 corrected", paper_controller
        ),
        "paper-printed-sign": Composition(
            "the same with erratum 6 as printed and a tube's nominal state: the vehicle is lost",
            printed_sign_controller,
        ),
        "pid": Composition("conventional guidance: a PID loop for each input", pid_controller),
        "lqr": Composition(
            "LQR on the articulated model and the filter's disturbances", lqr_controller
        ),
        "nmpc": Composition(
            "nonlinear MPC, converged: horizon, weights, bounds of the linear one", nmpc_controller
        ),
        "nmpc-rti": Composition(
            "the same with one Gauss-Newton iteration a period", nmpc_rti_controller
        ),
        "nmpc-decentralised": Composition(
            "tractor and trailer each with an NMPC, the other's inputs taken as held",
            nmpc_decentralised_controller,
        ),
        "nmpc-distributed": Composition(
            "the same, plans exchanged once a period", nmpc_distributed_controller
        ),
        "feedforward": Composition(
            "inputs of the exact reference geometry, no feedback", feedforward_controller
        ),
    }
)


def composition(name: str) -> Composition:
    """Return the entry of the controller called `name`.

    Raises:
        UnknownController: with the names that exist.
    """
    if name not in CONTROLLERS:
        raise UnknownController(
            f"controller {name!r} does not exist; allowed are {', '.join(sorted(CONTROLLERS))}"
        )
    return CONTROLLERS[name]


def make_controller(
    name: str,
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
    design: TubeDesign | None = None,
) -> Controller:
    """Return the controller called `name` for a command every `period_s`.

    `design` is the tube of those that keep to one or watch one; others pass it over.

    Raises:
        UnknownController: with the names that exist.
        InvalidTube: there is no design, or it does not fit vehicle and reference.
    """
    found = composition(name)
    if found.tube == "keeps" and design is None:
        raise InvalidTube(f"controller {name!r}: needs the design of a tube")
    if found.tube is None or design is None:
        return found.make(vehicle, reference, period_s)
    return found.make(vehicle, reference, period_s, design=design)
