"""Table of docs/evidence.md: all published figures beside those of the plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from ..batch import run_tasks
from .evidence import Evidence, table, verdict_line
from .handling import sensitivity, yaw_response
from .passes import (
    implement_steering,
    nearest_points,
    receivers,
    revisit,
    steered_joint,
)
from .tillage import tool_forces, transport_slip, unsteered_tool, working_slip
from .wheel import best_slip, combined_slip, second_pass

Experiment = Callable[[], list[Evidence]]

EXPERIMENTS: Final[tuple[Experiment, ...]] = (
    combined_slip,
    best_slip,
    second_pass,
    working_slip,
    transport_slip,
    tool_forces,
    unsteered_tool,
    yaw_response,
    sensitivity,
    implement_steering,
    steered_joint,
    receivers,
    nearest_points,
    revisit,
)


def evidence(experiments: Sequence[Experiment] = EXPERIMENTS) -> list[Evidence]:
    """Return the figures of all experiments, made on all cores, in the order of the page."""
    return [item for items in run_tasks(_perform, experiments) for item in items]


def evidence_page(experiments: Sequence[Experiment] = EXPERIMENTS) -> str:
    """Return the verdict and the table of docs/evidence.md."""
    items = evidence(experiments)
    return f"{verdict_line(items)}\n\n{table(items)}"


def _perform(experiment: Experiment) -> list[Evidence]:
    return experiment()
