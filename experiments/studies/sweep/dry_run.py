"""Dry run of a plan: its axes and its size."""

import itertools
from typing import Final

from .plan import SweepPlan

_SHOWN: Final = 12  # values of an axis


def format_plan(plan: SweepPlan) -> str:
    """Return axes and size of a plan as lines of text."""
    study = plan.study
    extent = plan.extent()
    lines = [f"{plan.name}: {study.description}".rstrip(": "), f"scenario  {study.scenario}"]
    for axis in study.axis:
        places = itertools.product(range(plan.points), range(plan.controller_count))
        changes = (plan.changes(*place) for place in places)
        each = ({str(change[name]): None for name in axis.names} for change in changes)
        values = [*dict.fromkeys(map(" & ".join, each))]
        more = f", {len(values) - _SHOWN} more" if len(values) > _SHOWN else ""
        lines.append(f"axis      {axis.label}: {', '.join(values[:_SHOWN])}{more}")
    lines += [
        f"seeds     {', '.join(map(str, study.point_seeds))}",
        f"runs      {extent.runs}: {extent.points} points, {len(study.point_seeds)} seeds, "
        f"{plan.controller_count} controllers ({', '.join(extent.controllers)})",
        f"time      {extent.simulated_s / 60.0:.1f} min simulated",
    ]
    return "\n".join(lines)
