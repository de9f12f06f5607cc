"""NMPC and moving-horizon estimator published for the vehicle of the paper."""

from typing import Final

CONTROLLER: Final = f"{__name__}.nmpc:controller"
ESTIMATOR: Final = f"{__name__}.nmhe:Estimator"
