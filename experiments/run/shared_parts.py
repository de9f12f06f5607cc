"""Parts of a run that later runs of the same process can use again."""

import copy
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from typing import Generic, TypeVar

from ttempc.guidance.controllers import make_controller
from ttempc.guidance.dead_time import lead_s
from ttempc.guidance.pipeline import ControllerFactory
from ttempc.laws.tracking_controller import TrackingController
from ttempc.reference.reference import Reference
from ttempc.vehicle import Vehicle

from ...testbed.ground.terrain import Terrain
from ..scenario.scenario import Scenario
from .user_code import named_factory, user_controller

Part = TypeVar("Part")


class Kept(Generic[Part]):
    """At most so many parts by what they were made from; the least recently used are dropped."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._parts = dict[Hashable, Part]()

    def get(self, key: Hashable, make: Callable[[], Part]) -> Part:
        """Return the part of this key, from `make` where it is not kept."""
        part = self._parts.pop(key) if key in self._parts else make()
        self._parts[key] = part  # the last of the dictionary is the latest
        if len(self._parts) > self.most:
            del self._parts[next(iter(self._parts))]
        return part


class SharedParts:
    """Terrains and controllers of runs; a run changes neither, so that its bits stay the same.

    At most so many are kept: a terrain has 3 MB at the default size, a controller up to 6 MB for
    each lap of the default path.
    """

    def __init__(self, terrains: int = 0, controllers: int = 0) -> None:
        self.terrains: Kept[Terrain] = Kept(terrains)
        self.controllers: Kept[TrackingController] = Kept(controllers)

    def terrain(self, scenario: Scenario, seed: int) -> Terrain:
        """Return the terrain of a run."""
        settings = scenario.terrain
        return self.terrains.get((settings, seed), lambda: settings.terrain(seed))

    def controller_factory(
        self, scenario: Scenario, given: Vehicle, factory: Callable[..., object] | None = None
    ) -> ControllerFactory:
        """Return what makes the controller of a run from vehicle, reference and period [s].

        `given` are the model parameters of the scenario; a user's `factory` replaces its own.
        """
        settings = scenario.controller
        if factory is None:
            factory = named_factory(settings.name, settings.options)
        if factory is None:
            return partial(self.controller, scenario, given)
        return partial(user_controller, settings.name, factory, settings.options)

    def controller(
        self,
        scenario: Scenario,
        given: Vehicle,
        vehicle: Vehicle,
        reference: Reference,
        period_s: float,
    ) -> TrackingController:
        """Return the shipped controller of a scenario before its first tick.

        A controller for parameters `vehicle` that were learnt, unlike those `given` by the
        scenario, belongs to one run and is not kept; its tube is that of the given ones.
        """
        settings = scenario.controller
        tube = settings.design(given, period_s)
        design = tube and replace(tube, vehicle=vehicle)
        make = partial(
            make_controller, settings.name, vehicle, reference, period_s, design, settings.options
        )
        learnt = vehicle != given.without_dead_times() or reference.lead_s != lead_s(given)
        if learnt or not self.controllers.most:
            return make()  # of a long run a copy would take 100 MB more
        # The reference follows from path and vehicle; of the settings, options have no hash.
        key = scenario.path, reference.corridor, given, period_s, repr(settings)
        return copy.deepcopy(self.controllers.get(key, make))
