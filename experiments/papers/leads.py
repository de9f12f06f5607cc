"""Places at which a controller is ahead of the default one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import pandas as pd

MARGIN_CM: Final = 0.05
"""Difference of mean errors below which none of two controllers counts as ahead [cm]."""


def leads(runs: pd.DataFrame, default: str = "ttempc") -> Iterator[tuple[str, str, float, int]]:
    """Yield all leads over `default`: more than `MARGIN_CM` of mean error, or fewer lost runs.

    Mean errors are those of pairs that both completed; pairs that one of the two did not drive
    count nowhere.

    Args:
        runs: with the columns `place`, `pair` (equal for runs under the same conditions),
            `controller` and `error_cm` (NaN for a lost run).
        default: name of the controller that the others are compared with.

    Yields:
        Place, controller, error of the default one less its own [cm] and the number of runs that
        the default one lost less those that it lost itself.
    """
    wide = runs.assign(lost=1.0 * runs["error_cm"].isna()).pivot(
        index=["place", "pair"], columns="controller", values=["error_cm", "lost"]
    )
    for place, controller in dict.fromkeys(zip(runs["place"], runs["controller"], strict=True)):
        own = wide.loc[[place]]
        gap = own.xs(default, axis=1, level=1) - own.xs(controller, axis=1, level=1)
        error_cm, fewer = float(gap["error_cm"].mean()), int(gap["lost"].sum())
        if error_cm > MARGIN_CM or fewer > 0:
            yield place, controller, error_cm, fewer


def leads_sentence(
    runs: pd.DataFrame,
    what: str,
    default: str = "ttempc",
    error: str = "the 95 % cross-track error of the working point",
) -> str:
    """Return a sentence that lists all leads over `default`.

    Args:
        runs: of all controllers, see `leads`.
        what: plural of the places, such as "fields".
        default: name of the controller that the others are compared with.
        error: what the error is.
    """
    ahead = []
    rest = set(runs["place"])
    for place, controller, error_cm, fewer in leads(runs, default):
        reasons = [f"{error_cm:.2f} cm"] if error_cm > MARGIN_CM else []
        reasons += [f"{fewer} lost run{'s' * (fewer > 1)} fewer"] if fewer > 0 else []
        ahead.append(f"`{controller}` on `{place}` ({', '.join(reasons)})")
        rest -= {place}
    rivals = ", ".join(f"`{name}`" for name in runs["controller"].unique() if name != default)
    listed = f"Ahead of `{default}`: {'; '.join(ahead)}. " if ahead else ""
    return (
        f"{listed}On {len(rest)} of {runs['place'].nunique()} {what} none of {rivals} is ahead of "
        f"`{default}` by more than {MARGIN_CM} cm in the mean of {error}, or in lost runs."
    )
