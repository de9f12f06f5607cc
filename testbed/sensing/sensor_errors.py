"""Error processes of sensors, each with its own random generators.

`errors(n)` returns the errors of the next n samples, (n, m). They do not depend on how many are
asked for at once.
"""

import math
from typing import Final

import numpy as np

from ttempc.types import FloatArray

_BAD_SHARE: Final = 0.1  # of the samples of a heavy-tailed error
_BAD_FACTOR: Final = 3.0  # of the standard deviation of these samples
_AHEAD: Final = 64  # white parts that a correlated error draws at once


class White:
    """Independent Gaussian errors around a constant bias.

    Args:
        sd: standard deviation of each entry, (m,).
        rng: generator of this sensor alone.
        bias: constant part of every error, (m,).
    """

    def __init__(
        self, sd: FloatArray, rng: np.random.Generator, bias: FloatArray | None = None
    ) -> None:
        self._rng = rng
        self._sd = sd
        self._bias = np.zeros(len(sd)) if bias is None else bias

    def errors(self, n: int) -> FloatArray:
        """Return the errors of the next samples, (n, m)."""
        return self._bias + self._sd * self._rng.standard_normal((n, len(self._sd)))


class Correlated:
    """Sum of a first-order Gauss-Markov process and a white part (Gelb 1974, sec. 3.6).

        x[k+1] = a x[k] + sqrt(1 - a^2) s w[k],  a = exp(-period / correlation time)

    The process starts stationary; its autocorrelation is exp(-dt / correlation time).

    Args:
        sd: standard deviation of the sum of both parts, (m,).
        white_share: of the variance, 0..1.
        correlation_time: [s].
        period: between samples [s].
        rng: generator of the white part.
        slow_rng: generator of the process.
    """

    def __init__(
        self,
        sd: FloatArray,
        white_share: float,
        correlation_time: float,
        period: float,
        rng: np.random.Generator,
        slow_rng: np.random.Generator,
    ) -> None:
        self._white = White(math.sqrt(white_share) * sd, rng)
        self._sd = math.sqrt(1.0 - white_share) * sd
        self._rng = slow_rng
        self._correlation = math.exp(-period / correlation_time)
        self._state = self._sd * slow_rng.standard_normal(len(sd))  # (m,)
        # White parts that are drawn already, the next one last. They are drawn in blocks of one
        # size, since both generators may be the same.
        self._ahead: list[FloatArray] = []

    def errors(self, n: int) -> FloatArray:
        """Return the errors of the next samples, (n, m)."""
        noise_sd = math.sqrt(1.0 - self._correlation**2) * self._sd
        errors = np.empty((n, len(self._sd)))
        for k in range(n):
            present = self._state
            noise = noise_sd * self._rng.standard_normal(len(noise_sd))
            self._state = self._correlation * present + noise
            self._ahead = self._ahead or list(self._white.errors(_AHEAD)[::-1])
            errors[k] = present + self._ahead.pop()
        return errors


class HeavyTailed:
    """Contaminated normal distribution: one sample in ten has three times the standard deviation.

    Tukey (1960). It models the paper's "non-Gaussian" errors: most fixes are good, some suffer from
    multipath, in both axes at once. All its moments are finite, unlike those of Student's t, and
    its standard deviation can be estimated from a run. Its excess kurtosis is 5.33.

    Args:
        sd: standard deviation of each entry of the mixture, (m,).
        rng: generator of this sensor alone.
    """

    def __init__(self, sd: FloatArray, rng: np.random.Generator) -> None:
        self._rng = rng
        self._good_sd = sd / math.sqrt(1.0 + _BAD_SHARE * (_BAD_FACTOR**2 - 1.0))

    def errors(self, n: int) -> FloatArray:
        """Return the errors of the next samples, (n, m)."""
        errors = np.empty((n, len(self._good_sd)))
        for k in range(n):
            factor = _BAD_FACTOR if self._rng.random() < _BAD_SHARE else 1.0
            errors[k] = factor * self._good_sd * self._rng.standard_normal(len(self._good_sd))
        return errors


class Wandering:
    """Error of a velocity: white noise, and a slow part that two receivers have in common.

    Args:
        sd: standard deviation of the white part, (m,).
        wander_sd: standard deviation of the slow part, (m,).
        correlation_time: of the slow part [s].
        period: between samples [s].
        rng: generator of the white part of this receiver.
        shared_rng: generator of the slow part; one of equal seed gives the same slow part.
    """

    def __init__(
        self,
        sd: FloatArray,
        wander_sd: FloatArray,
        correlation_time: float,
        period: float,
        rng: np.random.Generator,
        shared_rng: np.random.Generator,
    ) -> None:
        self._white = White(sd, rng)
        self._slow = Correlated(wander_sd, 0.0, correlation_time, period, shared_rng, shared_rng)

    def errors(self, n: int) -> FloatArray:
        """Return the errors of the next samples, (n, m)."""
        return self._white.errors(n) + self._slow.errors(n)


ErrorSource = White | Correlated | HeavyTailed | Wandering
