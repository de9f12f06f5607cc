"""Code of a user: controllers, estimators and stages named `package.module:factory`."""

import hashlib
import importlib
import inspect
import os
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from pathlib import Path
from types import ModuleType
from typing import Any, Final, NoReturn

import numpy as np

from ttempc.estimation.noise import SensorNoise
from ttempc.guidance.controllers import controller_options, estimator_factory
from ttempc.reference.reference import Reference
from ttempc.suggestion import did_you_mean
from ttempc.types import Controller, Estimator
from ttempc.vehicle import Vehicle

from ...testbed.errors import StageFailed
from ...testbed.simulation.setup import SimulationSetup, Stage, TickContext
from ..errors import InvalidController, InvalidScenario
from ..scenario.controller import StageSettings
from ..scenario.scenario import Scenario

_ROLES: Final = {  # by key of a scenario
    "controller.name": "controller",
    "controller.estimator": "estimator",
    "stages.make": "stage",
}
_MOST_OFFERED: Final = 20  # names of a module in a message

_leave = os._exit
_guarded = threading.local()  # .pid: of the process in which this thread is in `exits_raise`


def _exit(status: int) -> NoReturn:
    if getattr(_guarded, "pid", None) == os.getpid():
        raise SystemExit(f"os._exit({status})")
    _leave(status)


@contextmanager
def exits_raise() -> Iterator[None]:
    """Raise `SystemExit` where `os._exit` is called in this block, by a user's Python code say.

    It would end the process without a word. Other threads and forked processes end as ever.
    """
    before = getattr(_guarded, "pid", None)
    os._exit = _exit
    _guarded.pid = os.getpid()
    try:
        yield
    finally:
        _guarded.pid = before


def is_user_code(name: str) -> bool:
    """Whether a name is of the form `package.module:factory`."""
    return ":" in name


@exits_raise()
def load_factory(name: str, what: str) -> Callable[..., object]:
    """Return the callable of the name `package.module:factory`; `what` is its role in messages.

    The module is looked for as by `python -m`: in the working directory too.

    Raises:
        InvalidController: no such module or attribute, a module that cannot be imported, or an
            attribute that is not callable.
    """
    module_name, _, attribute = name.partition(":")

    def refuse(why: str) -> InvalidController:
        return InvalidController(f"{what} {name!r}: {why}")

    if not all(part.isidentifier() for part in (*module_name.split("."), *attribute.split("."))):
        raise refuse("must be package.module:factory, as lawn.steering:make_controller")
    folder = _search_working_directory()
    try:
        item: object = importlib.import_module(module_name)
    except ModuleNotFoundError as error:
        raise refuse(
            f"no module {error.name!r}; it is looked for in {folder} and among the installed "
            "packages"
        ) from None
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's module may raise anything, SystemExit too
        raise refuse(f"importing {module_name} raised {_in_a_line(error)}") from error
    for part in attribute.split("."):
        if not hasattr(item, part):
            offered = _offered(sys.modules[module_name], attribute)
            raise refuse(f"{module_name} has no {attribute}{offered}")
        item = getattr(item, part)
    if not callable(item):
        raise refuse(f"{attribute} is {type(item).__name__}, must be callable")
    return item


def named_factory(name: str, options: Mapping[str, object]) -> Callable[..., object] | None:
    """Return the factory of a user's controller, None for one that ships and takes the options."""
    if is_user_code(name):
        return load_factory(name, "controller")
    controller_options(name, options)
    return None


def user_controller(
    name: str,
    factory: Callable[..., object],
    options: Mapping[str, object],
    vehicle: Vehicle,
    reference: Reference,
    period_s: float,
) -> Controller:
    """Return the controller that `factory(vehicle, reference, period_s, **options)` makes."""
    arguments = (vehicle, reference, period_s)
    return _made(name, "controller", factory, arguments, options, "step(estimate, k)")


def named_estimator(name: str, vehicle: Vehicle, sensor_noise: SensorNoise) -> Estimator:
    """Return the estimator of a name: one that ships, or what a user's factory makes."""
    if not is_user_code(name):
        return estimator_factory(name)(vehicle, sensor_noise)
    factory = load_factory(name, "estimator")
    method = "update(time_s, measurements, command)"
    return _made(name, "estimator", factory, (vehicle, sensor_noise), {}, method)


def user_stage(settings: StageSettings, generator: np.random.Generator) -> Stage:
    """Return the stage that `factory(generator, **options)` makes.

    An exception in the stage ends the run as invalid.
    """
    name = settings.make
    stage = _made(name, "stage", load_factory(name, "stage"), (generator,), settings.options)
    if not callable(stage):
        raise InvalidController(
            f"stage {name!r}: the factory returned {type(stage).__name__}, must be a function of "
            "the simulation set-up and the tick's context"
        )

    def run(setup: SimulationSetup, tick: TickContext) -> None:
        try:
            stage(setup, tick)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a user's stage may raise anything, SystemExit too
            raise StageFailed(
                f"the stage {name} raised at tick {tick.k}: {type(error).__name__}: {error}"
            ) from error

    return run


def refuse_untrusted(
    file: Path, parts: Iterable[tuple[str, str]], changes: Mapping[str, Any]
) -> None:
    """Refuse a file that names code which the changes to it do not name.

    `file` is how a message names it, `parts` are as of `named_parts`, `changes` the tables that the
    user gave on the command line, or that a study gave.

    Raises:
        InvalidScenario: with the name of the code, and what allows it.
    """
    own = set(_texts(changes))
    for key, name in parts:
        if is_user_code(name) and name not in own:
            raise InvalidScenario(
                f"{file}: {key} = {name!r} is code that this file asks to run; if you trust it, "
                "give --trust, or name it yourself where the command has --controller or --set"
            )


def named_parts(scenario: Scenario) -> list[tuple[str, str]]:
    """Return key and name of every part of a scenario that may be a user's code."""
    settings = scenario.controller
    parts = [("controller.name", settings.name), ("controller.estimator", settings.estimator)]
    return parts + [("stages.make", stage.make) for stage in scenario.stages]


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for item in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(item)


def name_of(factory: Callable[..., object]) -> str:
    """Return the name `module:qualname` under which runs of a factory are filed."""
    kind, _ = _definition(factory)
    return f"{kind.__module__}:{kind.__qualname__}"


def source_digest(factory: Callable[..., object]) -> str:
    """Return a hash of the module in which a factory is defined, and of bound arguments.

    Of code without a file it is the source of the factory; "unknown" where that does not exist.
    """
    kind, bound = _definition(factory)
    content = _source(kind)
    if content is None:
        return "unknown"
    return hashlib.sha256(content + bound.encode()).hexdigest()[:12]


@cache
def _source(kind: Any) -> bytes | None:  # noqa: ANN401 - a function or a class
    """Return the source of a definition as it was when first asked for: of the loaded code."""
    try:
        file = inspect.getsourcefile(kind)
        if file and Path(file).is_file():
            return Path(file).read_bytes()
        return inspect.getsource(kind).encode()
    except (OSError, TypeError):
        return None


def user_sources(
    scenario: Scenario, factory: Callable[..., object] | None = None
) -> dict[str, str]:
    """Return a hash of the source of controller, estimator and stages where they are a user's.

    `factory` is that of the controller, where it is not to be found by its name.
    """
    sources = {}
    if factory is not None:
        sources[f"controller {scenario.controller.name}"] = source_digest(factory)
    for key, name in named_parts(scenario)[factory is not None :]:
        if is_user_code(name):
            what = _ROLES[key]
            sources[f"{what} {name}"] = source_digest(load_factory(name, what))
    return sources


def _definition(factory: Callable[..., object]) -> tuple[Any, str]:
    if isinstance(factory, partial):
        return factory.func, f"{factory.args} {factory.keywords}"
    return (factory if hasattr(factory, "__qualname__") else type(factory)), ""


def _made(
    name: str,
    what: str,
    factory: Callable[..., object],
    arguments: tuple[object, ...],
    options: Mapping[str, object],
    method: str = "",
) -> Any:  # noqa: ANN401 - a user's object
    """Return what a factory makes; it must have the `method`, given with its arguments."""
    try:
        made = factory(*arguments, **options)
        found = not method or callable(getattr(made, method.partition("(")[0], None))
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a user's factory may raise anything, SystemExit too
        raise InvalidController(f"{what} {name!r}: raised {_in_a_line(error)}") from error
    if not found:
        raise InvalidController(
            f"{what} {name!r}: the factory returned {type(made).__name__}, which has no method "
            f"{method}"
        )
    return made


def _offered(module: ModuleType, attribute: str) -> str:
    names = [
        name
        for name, item in vars(module).items()
        if getattr(item, "__module__", "") == module.__name__ and not name.startswith("_")
    ]
    return f"; it defines {', '.join(names[:_MOST_OFFERED])}{did_you_mean(attribute, names)}"


def _search_working_directory() -> str:
    """Let modules of the working directory be found, after all installed ones; return it."""
    folder = os.getcwd()
    if folder not in sys.path:
        sys.path.append(folder)
    importlib.invalidate_caches()
    return folder


def _in_a_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"
