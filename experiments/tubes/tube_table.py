"""A fitted tube in a few lines of text."""

from __future__ import annotations

import numpy as np

from ..results.containment import Containment
from ..scenario.tube_file import HoldOut
from .fit import Fit


def tube_table(fit: Fit) -> str:
    """Return half widths, what they leave of the inputs, and what the hold-out says."""
    said, certificate = fit.file.provenance, fit.along.tube.certificate
    free = fit.along.free_share
    lines = [
        f"Runs      {', '.join(said.scenarios)}: {len(said.fitted_seeds)} fitted, "
        f"{len(said.held_out_seeds)} held out",
        f"Set       {fit.file.disturbance.shape}, windows of {fit.file.disturbance.window} steps, "
        f"coverage {said.coverage:g}",
        f"Hold-out  disturbance {_share(said.disturbance, said.confidence)}",
        f"          error of the estimate {_share(said.estimate_error, said.confidence)}",
        f"Tube      alpha {certificate.alpha:.3f} after {certificate.terms} windows",
        "",
        f"{'half width':<24}{'straight':>10}{'curve':>10}{'largest':>10}",
    ]
    for body, column in Containment.ACROSS.items():
        lines.append(_row(f"{body} cross-track", fit.along.half_widths[:, column], fit, "m"))
    lines.append(f"{'free share of range':<24}{'straight':>10}{'curve':>10}{'least':>10}")
    for column, name in enumerate(("front steering", "trailer steering", "hydrostat")):
        lines.append(_row(name, free[:, column], fit, "", least=True))
    return "\n".join(lines)


def _share(found: HoldOut, confidence: float) -> str:
    return (
        f"{found.inside} of {found.windows} windows inside ({100.0 * confidence:g} %: "
        f"{found.low:.4f} to {found.high:.4f})"
    )


def _row(name: str, values: np.ndarray, fit: Fit, unit: str, *, least: bool = False) -> str:
    shown = values[fit.straight], values[fit.curve], values.min() if least else values.max()
    label = f"  {name}{f' [{unit}]' if unit else ''}"
    return f"{label:<24}" + "".join(f"{value:>10.3f}" for value in shown)
