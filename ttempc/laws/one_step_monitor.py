"""Monitor of one-step residuals against their measured set."""

from __future__ import annotations

from ..tube.reference_tube import TubeDesign, report_rows
from ..types import FloatArray, TubeReport
from .robust_kernel import containment


class OneStepMonitor:
    """Containment of the residual of each step, for a law that predicts its nominal state anew.

    The nominal state is predicted from the estimate of the previous tick and the input that was
    sent, robust action included. The deviation zhat - zbar is then the disturbance w of that step
    alone. It lies in the set W of single steps, whatever the gain, to W's coverage; the true error
    lies in W widened by the error of the estimate. Nothing has to contract, and nothing follows
    for later steps.

    Args:
        design: the tube whose sets count.
        outputs: C (T, 4, 7) of the error dynamics along the reference.
    """

    def __init__(self, design: TubeDesign, outputs: FloatArray) -> None:
        self._inverse, _ = design.disturbance.faces
        self._ellipsoid = design.disturbance.shape == "ellipsoid"
        self._rows = report_rows(outputs)  # (T, 9, 7)
        rows = self._rows.reshape(-1, outputs.shape[-1])
        width = design.disturbance.support(rows) + design.estimate_error.support(rows)
        self._half_widths = width.reshape(self._rows.shape[:2])  # (T, 9)

    def report(self, k: int, nominal: FloatArray, deviation: FloatArray) -> TubeReport:
        """Return the containment of the `deviation` (7,) from the `nominal` error (7,) at tick `k`.

        The margin is 1 less the gauge of the deviation in W.
        """
        gauge, errors = containment(
            k, self._inverse, self._ellipsoid, self._rows, nominal, deviation
        )
        return TubeReport(gauge <= 1.0, 1.0 - gauge, errors, self._half_widths[k])
