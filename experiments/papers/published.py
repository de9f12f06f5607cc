"""Published mean Euclidean errors of a field experiment.

Kayacan, Ramon, Saeys (2016), "Robust Trajectory Tracking Error Model-Based Predictive Control for
Unmanned Ground Vehicles", section V: the time-based linear MPC with the robust action.
"""

from __future__ import annotations

from typing import Final

from ...testbed.vehicle.vehicle import DEFAULT_VEHICLE, read_vehicle
from ..scenario.path import FigureEight
from ..scenario.scenario import Scenario

PUBLISHED_M: Final = {
    ("straight", "tractor"): 0.2349,
    ("straight", "trailer"): 0.2121,
    ("curve", "tractor"): 0.3982,
    ("curve", "trailer"): 0.3621,
}
"""Published errors by part of the path and body."""

PUBLISHED_LMPC_M: Final = tuple(PUBLISHED_M.values())
"""Mean Euclidean errors of the linear MPC [m], in the order of `COLUMNS`."""

PUBLISHED_NMPC_M: Final = (0.0644, 0.0361, 0.4978, 0.4152)
"""The same of a space-based nonlinear MPC of the same vehicle, quoted there in section V from
Kayacan, Kayacan, Ramon, Saeys (2015), IEEE Transactions on Control Systems Technology 23(1)."""

COLUMNS: Final = tuple(f"{body} {where}" for where, body in PUBLISHED_M)
"""Labels of these numbers."""


def applies_to(scenario: Scenario) -> bool:
    """Return whether a scenario has the paper's vehicle and path, so that the figures compare.

    The path is the figure eight of 10 m radius at 1 m/s, the vehicle that of the file
    `kayacan2016`, unchanged and without a tool in the soil.
    """
    path = scenario.path
    same_path = isinstance(path, FigureEight) and path == FigureEight(laps=path.laps)
    return (
        same_path
        and not scenario.implement
        and scenario.vehicles().plant == read_vehicle(DEFAULT_VEHICLE)
    )
