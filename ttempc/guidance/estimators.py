"""Estimators by name."""

from __future__ import annotations

from collections.abc import Callable
from types import MappingProxyType
from typing import Final

from ..baselines.nmhe import MovingHorizonEstimator
from ..baselines.nmhe_printed import PrintedEstimator
from ..errors import UnknownEstimator
from ..estimation.ekf import ExtendedKalmanFilter
from ..estimation.noise import SensorNoise
from ..suggestion import did_you_mean
from ..types import Estimator
from ..vehicle import Vehicle

EstimatorFactory = Callable[[Vehicle, SensorNoise], Estimator]
"""Makes an estimator from the model parameters and the assumed sensor noise."""

ESTIMATORS: Final = MappingProxyType[str, EstimatorFactory](
    {
        "ekf": ExtendedKalmanFilter,
        "nmhe": MovingHorizonEstimator,
        "kayacan-nmhe": PrintedEstimator,
    }
)


def estimator_factory(name: str) -> EstimatorFactory:
    """Return the factory of the estimator called `name`.

    Raises:
        UnknownEstimator: with the names that exist.
    """
    if name not in ESTIMATORS:
        raise UnknownEstimator(
            f"estimator {name!r} does not exist; allowed are {', '.join(sorted(ESTIMATORS))}"
            f"{did_you_mean(name, ESTIMATORS)}"
        )
    return ESTIMATORS[name]
