"""Many runs of a scenario at once, a process for each."""

from typing import Any

from gymnasium.vector import AsyncVectorEnv

from ...errors import BadOptions
from .environment import FieldTrial

_MOST: int = 1024
"""Environments of a vector, processes therefore; assumed."""


def field_trials(num_envs: int = 1, **options: Any) -> AsyncVectorEnv:  # noqa: ANN401
    """Return a vector of environments with the same options, as `gymnasium.make_vec` asks for.

    `reset(seed=N)` gives them the seeds N, N + 1 and so on.

    Args:
        num_envs: how many; more than the machine has cores share them.
        options: those of `FieldTrial`.

    Raises:
        BadOptions: the number is none, or an option has none of the allowed values.
    """
    if not isinstance(num_envs, int) or not 1 <= num_envs <= _MOST:
        raise BadOptions(f"num_envs: must be from 1 to {_MOST}, got {num_envs!r}")
    return AsyncVectorEnv([lambda: FieldTrial(**options)] * num_envs)
