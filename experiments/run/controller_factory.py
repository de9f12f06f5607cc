"""The maker of a controller that a name stands for: one of the project's, or one of your own."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Callable
from functools import partial

from ttempc.guidance.controllers import composition, make_controller
from ttempc.reference.reference import Reference
from ttempc.tube.reference_tube import TubeDesign
from ttempc.types import Controller
from ttempc.vehicle import Vehicle

from ..errors import InvalidController

ControllerFactory = Callable[[Vehicle, Reference, float], Controller]
"""Makes a controller from the vehicle as believed, the reference and the control period [s]."""


def controller_factory(name: str, design: TubeDesign | None = None) -> ControllerFactory:
    """Return the maker of the controller called `name`, with the tube of those that have one.

    A name with a colon, `package.module:factory`, is of your own package: importable as by
    `python -m`, that is from the working directory, too.

    Raises:
        InvalidController: no such module or factory, or a module that cannot be imported.
        UnknownController: the project has none of that name.
    """
    if ":" in name:
        return partial(_made, name, _imported(name))
    composition(name)  # refuses a name that does not exist now, not when it is to drive
    return partial(make_controller, name, design=design)


def _imported(name: str) -> Callable[..., object]:
    module_name, _, attribute = name.partition(":")
    if not all(part.isidentifier() for part in (*module_name.split("."), *attribute.split("."))):
        raise InvalidController(
            f"controller {name!r}: must be package.module:factory, as lawn.steering:make_controller"
        )
    here = os.getcwd()
    if here not in sys.path:
        sys.path.insert(0, here)
    importlib.invalidate_caches()
    try:
        found: object = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise InvalidController(
            f"controller {name!r}: no module {error.name!r}; it is looked for in {here} and among "
            "the installed packages"
        ) from None
    except Exception as error:  # a module of anyone's may raise anything
        raise InvalidController(
            f"controller {name!r}: importing {module_name} raised {_in_a_line(error)}"
        ) from error
    for part in attribute.split("."):
        if not hasattr(found, part):
            raise InvalidController(f"controller {name!r}: {module_name} has no {attribute}")
        found = getattr(found, part)
    if not callable(found):
        raise InvalidController(
            f"controller {name!r}: {attribute} is {type(found).__name__}, must be callable as "
            "factory(vehicle, reference, period_s)"
        )
    return found


def _made(
    name: str,
    factory: Callable[..., object],
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
) -> Controller:
    try:
        controller = factory(vehicle, reference, period_s)
    except Exception as error:  # a factory of anyone's may raise anything
        raise InvalidController(
            f"controller {name!r}: factory(vehicle, reference, period_s) raised {_in_a_line(error)}"
        ) from error
    if not callable(getattr(controller, "step", None)):
        raise InvalidController(
            f"controller {name!r}: the factory returned {type(controller).__name__}, which has no "
            "method step(estimate, k)"
        )
    return controller  # pyright: ignore[reportReturnType] - as far as can be seen from here


def _in_a_line(error: Exception) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
