"""Markdown of the study."""

from __future__ import annotations

import numpy as np

from ttempc.types import FloatArray

from ..batch import started_workers
from .parameters import Parameter
from .runs import RunStore
from .study import (
    BOTH,
    LMPC_ON_FIELD,
    NAMES,
    ONE_LAP,
    PUBLISHED_CM,
    REPORT_SEEDS,
    WITHIN,
    Found,
    differences,
    find,
    shipped_field_cm,
)

STAGES = ("fit", "search", "all")
BUDGET, FIT_BUDGET = 48, 32


def fit_table(fit: Found, shipped_cm: FloatArray) -> str:
    """Return the fit of the linear MPC's four numbers: best field, and the shipped scenario."""
    lines = [
        f"Best of {len(fit.trials)} fields for `paper`: {_values(fit)}. Distance on the tuning "
        f"seeds {_distance(fit.tuning_cm, PUBLISHED_CM[:4])}, on the report seeds "
        f"{_distance(fit.mean_cm, PUBLISHED_CM[:4])}.",
        "",
        "| controller, error [cm] | published | best field | `kayacan2016` |",
        "|---|---|---|---|",
    ]
    for i, name in enumerate(NAMES):
        best = _spread(fit.report_cm[:, i]) if i < fit.report_cm.shape[1] else "-"
        cells = f"{PUBLISHED_CM[i]:.2f} | {best} | {_spread(shipped_cm[:, i])}"
        lines.append(f"| {name} | {cells} |")
    return "\n".join(lines)


def search_table(found: Found) -> str:
    """Return the best set for all eight numbers, and how near each number came by itself."""
    each = differences(found.trial_errors_cm, PUBLISHED_CM)  # (trials, 8)
    count = len(found.trials)
    lines = [
        "| controller, error [cm] | published | best set | ours / published | "
        f"sets within {WITHIN:.0%} |",
        "|---|---|---|---|---|",
    ]
    for i, name in enumerate(NAMES):
        ratio = found.mean_cm[i] / PUBLISHED_CM[i]
        cells = (
            f"{PUBLISHED_CM[i]:.2f}",
            _spread(found.report_cm[:, i]),
            "-" if np.isnan(ratio) else f"{ratio:.2f}",
            f"{np.sum(each[:, i] <= WITHIN)} of {count}",
        )
        lines.append(f"| {name} | {' | '.join(cells)} |")
    lines += ["", verdict(found), "", "| parameter | bounds | best set |", "|---|---|---|"]
    for item, share in zip(found.problem.parameters, found.point.tolist(), strict=True):
        lines.append(f"| {item.name} | {item.bounds} | {_value(item, share)} |")
    return "\n".join(lines)


def verdict(found: Found) -> str:
    """Return whether the best set has every number, and which numbers it does not have."""
    published = found.problem.published_cm
    off = differences(found.mean_cm, published) > WITHIN
    lost = np.isnan(found.report_cm)[:, ::4].any(axis=1).sum()
    rms = _distance(found.mean_cm, published)
    if not off.any() and not lost:
        return f"Found within {WITHIN:.0%} each; distance {rms} on the report seeds."
    names = ", ".join(f"{name} ({_times(found, i)})" for i, name in enumerate(NAMES) if off[i])
    return (
        f"No set found in {len(found.trials)} evaluations within these bounds; the best has a "
        f"distance of {rms} on the report seeds, {lost} of {len(REPORT_SEEDS)} with a lost run. "
        + (f"Beyond {WITHIN:.0%}: {names}." if names else "")
    ).strip()


def _times(found: Found, i: int) -> str:
    ratio = found.mean_cm[i] / PUBLISHED_CM[i]
    return "lost" if np.isnan(ratio) else f"{ratio:.2f} times the published"


def _distance(errors_cm: FloatArray, published_cm: FloatArray) -> str:
    return f"{np.sqrt(np.mean(np.square(differences(errors_cm, published_cm)))):.2f}"


def _spread(errors_cm: FloatArray) -> str:
    """Return mean, least and greatest of the seeds that completed, and how many were lost."""
    completed = errors_cm[np.isfinite(errors_cm)]
    if not completed.size:
        return "-"
    lost = len(errors_cm) - completed.size
    text = f"{completed.mean():.1f} ({completed.min():.1f}-{completed.max():.1f})"
    return f"{text}, {lost} lost" if lost else text


def _values(found: Found) -> str:
    pairs = zip(found.problem.parameters, found.point.tolist(), strict=True)
    return ", ".join(f"{item.name} {_value(item, share)}" for item, share in pairs)


def _value(item: Parameter, share: float) -> str:
    value = item.value(share)
    return value if isinstance(value, str) else f"{value:g}"


def print_tables(
    stage: str = "all",
    budget: int = BUDGET,
    fit_budget: int = FIT_BUDGET,
    path: tuple[str, ...] | None = None,
) -> None:
    """Print the tables of a stage; `path` overrides that of every run."""
    parts = []
    with started_workers() as engine:
        store = RunStore(engine)
        if stage in ("fit", "all"):
            fit = find(LMPC_ON_FIELD, store, fit_budget, path or ONE_LAP)
            parts.append(fit_table(fit, shipped_field_cm(store, path or ())))
        if stage in ("search", "all"):
            parts.append(search_table(find(BOTH, store, budget, path or ONE_LAP)))
    print("\n\n".join(parts))
