"""Environment of Gymnasium; importing this module registers it.

import gymnasium
import proving_ground.gym

environment = gymnasium.make("proving_ground/FieldTrial-v3", scenario="grass")
"""

from .experiments.interfaces.gym_env import ENVIRONMENT_ID
from .experiments.interfaces.gym_env.environment import FieldTrial

__all__ = ["ENVIRONMENT_ID", "FieldTrial"]
