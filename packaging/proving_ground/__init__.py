"""MuJoCo proving ground for controllers of towed agricultural machines.

    from proving_ground import load, simulate

    name, scenario = load("grass", ["path.laps=1"])
    summary, record = simulate(name, scenario, seed=1)

`mjcf`, `testbed` and `experiments` lie in this package in an installation, at the root of the
repository in a checkout. They are imported as parts of this package only, so that their common
names stay free for packages of a user's own repository.
"""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ttempc import __version__

if TYPE_CHECKING:
    from .experiments.pictures.report.run_page import write_page
    from .experiments.run.run_folder import run
    from .experiments.run.simulate import simulate
    from .experiments.scenario.scenario import Scenario, load
    from .experiments.studies.sweep.engine import engine
    from .experiments.studies.sweep.sweep import drive_points
    from .testbed.ground.ground import Ground
    from .testbed.log.reader import read_log
    from .testbed.recording.record import Record
    from .testbed.wheels.soil_law import SoilLaw
    from .testbed.wheels.soil_wheels import SoilWheels
    from .testbed.wheels.tyre import Tyre

if not (Path(__file__).parent / "testbed").is_dir():
    __path__.append(str(Path(__file__).parents[2]))

# Before anything here imports MuJoCo: few of its users need a picture.
import_module(".testbed.deferred_renderer", __name__).defer_renderer()

__all__ = [
    "Ground",
    "Record",
    "Scenario",
    "SoilLaw",
    "SoilWheels",
    "Tyre",
    "__version__",
    "drive_points",
    "engine",
    "load",
    "read_log",
    "run",
    "simulate",
    "write_page",
]

_MODULE_OF = {
    "Ground": "testbed.ground.ground",
    "Record": "testbed.recording.record",
    "Scenario": "experiments.scenario.scenario",
    "SoilLaw": "testbed.wheels.soil_law",
    "SoilWheels": "testbed.wheels.soil_wheels",
    "Tyre": "testbed.wheels.tyre",
    "drive_points": "experiments.studies.sweep.sweep",
    "engine": "experiments.studies.sweep.engine",
    "load": "experiments.scenario.scenario",
    "read_log": "testbed.log.reader",
    "run": "experiments.run.run_folder",
    "simulate": "experiments.run.simulate",
    "write_page": "experiments.pictures.report.run_page",
}


def __getattr__(name: str) -> object:
    """Load a public name from its module."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(import_module(f".{_MODULE_OF[name]}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
