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

__version__ = "0.2.0"

if TYPE_CHECKING:
    from .errors import TtempcError as TtempcError
    from .estimation.ekf import ExtendedKalmanFilter as ExtendedKalmanFilter
    from .estimation.noise import ProcessNoise as ProcessNoise
    from .estimation.noise import SensorNoise as SensorNoise
    from .guidance.controllers import CONTROLLERS as CONTROLLERS
    from .guidance.controllers import ESTIMATORS as ESTIMATORS
    from .guidance.controllers import make_controller as make_controller
    from .guidance.guidance import Guidance as Guidance
    from .guidance.safety import SafetyLimits as SafetyLimits
    from .guidance.settings import GuidanceSettings as GuidanceSettings
    from .guidance.state import GuidanceState as GuidanceState
    from .reference.headland import headland as headland
    from .reference.path import Path as Path
    from .reference.path import figure_eight as figure_eight
    from .reference.path import straight as straight
    from .reference.reference import ConstantSpeed as ConstantSpeed
    from .reference.reference import Reference as Reference
    from .reference.smoothing import smooth as smooth
    from .reference.speed import PlannedSpeed as PlannedSpeed
    from .types import Command as Command
    from .types import Controller as Controller
    from .types import ControlStep as ControlStep
    from .types import Diagnostics as Diagnostics
    from .types import Estimate as Estimate
    from .types import Estimator as Estimator
    from .types import Input as Input
    from .types import Measurement as Measurement
    from .types import Sensor as Sensor
    from .types import State as State
    from .vehicle import CommandLimits as CommandLimits
    from .vehicle import Vehicle as Vehicle

_HOME = {
    "errors": "TtempcError",
    "estimation.ekf": "ExtendedKalmanFilter",
    "estimation.noise": "ProcessNoise SensorNoise",
    "guidance.controllers": "CONTROLLERS ESTIMATORS make_controller",
    "guidance.guidance": "Guidance",
    "guidance.safety": "SafetyLimits",
    "guidance.settings": "GuidanceSettings",
    "guidance.state": "GuidanceState",
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

__all__ = ["__version__", *_MODULE_OF]  # pyright: ignore[reportUnsupportedDunderAll]


def __getattr__(name: str) -> object:
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
