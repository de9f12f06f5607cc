"""What one step added beside the model, held against the set that was measured for it."""

from __future__ import annotations

from ..tube.reference_tube import TubeDesign, seen
from ..types import FloatArray, TubeReport


class StepSet:
    """The tube of a law whose nominal state is predicted anew from every estimate.

    One step ago the nominal state was the estimate, and the input that was sent is known, robust
    action included: what is left of the deviation zhat - zbar is the disturbance w of that step
    alone. It lies in the set W of single steps, whatever gain drives, as far as W's coverage goes;
    the true error lies in W widened by the error of the estimate. Nothing has to contract, and
    nothing is said of later steps.
    """

    def __init__(self, design: TubeDesign, outputs: FloatArray) -> None:
        """Take `outputs` (T, 4, 7) from the error dynamics along the reference."""
        self._steps = design.disturbance
        self._seen = seen(outputs)  # (T, 9, 7)
        rows = self._seen.reshape(-1, outputs.shape[-1])
        width = design.disturbance.support(rows) + design.estimate_error.support(rows)
        self._half_widths = width.reshape(self._seen.shape[:2])

    def report(self, k: int, nominal: FloatArray, deviation: FloatArray) -> TubeReport:
        """Return where the `deviation` (7,) from the `nominal` error (7,) lies at tick `k`."""
        margin = 1.0 - self._steps.gauge(deviation)
        return TubeReport(margin >= 0.0, margin, self._seen[k] @ nominal, self._half_widths[k])
