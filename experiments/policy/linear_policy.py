"""Linear policy: gains on an observation, as a residual on a controller that ships."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

import numpy as np
import tomli_w
from pydantic import Field
from pydantic.dataclasses import dataclass

from ttempc.guidance.controllers import controller_entry, make_controller
from ttempc.reference.reference import Reference
from ttempc.suggestion import did_you_mean
from ttempc.types import Estimate, FloatArray
from ttempc.vehicle import Vehicle

from ...testbed.configuration.config_io import STRICT, Fraction, read_toml, validated
from ...testbed.configuration.resources import ShippedFiles
from ..errors import InvalidController
from ..gym_env.observation import ESTIMATE_NAMES, EstimateObserver
from ..gym_env.residual import ResidualController

_POLICIES: Final = ShippedFiles(
    "policy", "proving_ground.experiments", "fitted", ".toml", InvalidController
)
INPUTS: Final = ("delta_t", "delta_i", "hp")
"""Names of the inputs in a policy file, in the order of `ttempc.types.Input`."""

Gains = dict[str, Annotated[float, Field(ge=-1e6, le=1e6)]]
"""Gain of an action in [-1, 1] on each named entry of the observation; of others it is 0."""


@dataclass(frozen=True, config=STRICT)
class LinearPolicy:
    """Policy file: action = gains times observation, cut to [-1, 1]."""

    format: Literal[1]
    """Version of this format."""
    about: str
    """How it was trained, in one line."""
    controller: str
    """Controller that ships, with its default options, to whose command the action is added."""
    share: Fraction
    """Share of half the range of a command that an action of 1 adds."""
    gains: dict[Literal["delta_t", "delta_i", "hp"], Gains]
    """Gains of each input."""

    def matrix(self) -> FloatArray:
        """Return the gains, (3, n) in the order of `ESTIMATE_NAMES`.

        Raises:
            InvalidController: the observation has no entry of a name.
        """
        result = np.zeros((len(INPUTS), len(ESTIMATE_NAMES)))
        for name, gains in self.gains.items():
            for entry, gain in gains.items():
                if entry not in ESTIMATE_NAMES:
                    raise InvalidController(
                        f"gains.{name}.{entry}: must be one of {', '.join(ESTIMATE_NAMES)}"
                        f"{did_you_mean(entry, ESTIMATE_NAMES)}"
                    )
                result[INPUTS.index(name), ESTIMATE_NAMES.index(entry)] = gain
        return result

    def to_toml(self) -> str:
        """Return the text of the policy file."""
        return tomli_w.dumps({key: getattr(self, key) for key in self.__dataclass_fields__})


def read_policy(name: str) -> LinearPolicy:
    """Return a policy.

    Args:
        name: of a policy that ships, or path of a TOML file.

    Raises:
        InvalidController: there is no such file, or a key or a value is not allowed.
    """
    file = _POLICIES.find(name)
    content: Mapping[str, Any] = read_toml(file, InvalidController)
    try:
        policy = validated(LinearPolicy, content, InvalidController)
        policy.matrix()
    except InvalidController as error:
        raise InvalidController(f"{file}: {error}") from None
    return policy


def learnt(
    vehicle: Vehicle, reference: Reference, period_s: float, policy: str = "pid-residual"
) -> ResidualController:
    """Return the controller of a policy; a factory for `module:factory` in a scenario.

    Args:
        vehicle: model parameters.
        reference: what to follow.
        period_s: control period [s].
        policy: name of a policy that ships, or path of a policy file.

    Raises:
        InvalidController: as `read_policy`.
        UnknownController: the policy's controller does not ship.
    """
    chosen = read_policy(policy)
    controller_entry(chosen.controller)
    gains, observer = chosen.matrix(), EstimateObserver(reference, period_s)

    def residual(estimate: Estimate, k: int, sent: FloatArray) -> FloatArray:
        return gains @ observer.observe(estimate, k, sent)

    inner = make_controller(chosen.controller, vehicle, reference, period_s)
    return ResidualController(inner, residual, chosen.share, reference, period_s)
