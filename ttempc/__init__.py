"""Guidance of a tractor with a steerable trailer: references, estimation, MPC, tubes.

    from ttempc import Guidance, Vehicle, figure_eight

    guidance = Guidance(Vehicle(), figure_eight())
    guidance.warm_up()
    guidance.update(time_s, measurements)    # every 0.2 s, with the samples since the last call
    command = guidance.step()

Names are loaded when they are first used, so that `import ttempc` takes no time.
"""

from importlib import import_module
from typing import TYPE_CHECKING

__version__ = "0.2.0.dev0"

if TYPE_CHECKING:
    from .errors import TtempcError
    from .estimation.ekf import ExtendedKalmanFilter
    from .estimation.noise import ProcessNoise, SensorNoise
    from .guidance.controllers import CONTROLLERS, ESTIMATORS, make_controller
    from .guidance.guidance import Guidance
    from .guidance.supervisor import SafetyLimits
    from .reference.headland import headland
    from .reference.path import Path, figure_eight, straight
    from .reference.reference import ConstantSpeed, Reference
    from .reference.smoothing import smooth
    from .reference.speed import PlannedSpeed
    from .types import (
        Command,
        Controller,
        ControlStep,
        Diagnostics,
        Estimate,
        Estimator,
        Input,
        Measurement,
        Sensor,
        State,
    )
    from .vehicle import CommandLimits, Vehicle

__all__ = [
    "CONTROLLERS",
    "ESTIMATORS",
    "Command",
    "CommandLimits",
    "ConstantSpeed",
    "ControlStep",
    "Controller",
    "Diagnostics",
    "Estimate",
    "Estimator",
    "ExtendedKalmanFilter",
    "Guidance",
    "Input",
    "Measurement",
    "Path",
    "PlannedSpeed",
    "ProcessNoise",
    "Reference",
    "SafetyLimits",
    "Sensor",
    "SensorNoise",
    "State",
    "TtempcError",
    "Vehicle",
    "__version__",
    "figure_eight",
    "headland",
    "make_controller",
    "smooth",
    "straight",
]

_HOME = {
    "errors": "TtempcError",
    "estimation.ekf": "ExtendedKalmanFilter",
    "estimation.noise": "ProcessNoise SensorNoise",
    "guidance.controllers": "CONTROLLERS ESTIMATORS make_controller",
    "guidance.guidance": "Guidance",
    "guidance.supervisor": "SafetyLimits",
    "reference.headland": "headland",
    "reference.path": "Path figure_eight straight",
    "reference.reference": "ConstantSpeed Reference",
    "reference.smoothing": "smooth",
    "reference.speed": "PlannedSpeed",
    "types": "Command Controller ControlStep Diagnostics Estimate Estimator "
    "Input Measurement Sensor State",
    "vehicle": "CommandLimits Vehicle",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
