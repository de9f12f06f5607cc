"""Gymnasium environment of the proving ground; importing it registers `ENVIRONMENT_ID`."""

from typing import Final

import gymnasium

ENVIRONMENT_ID: Final = "proving_ground/FieldTrial-v3"

gymnasium.register(
    ENVIRONMENT_ID,
    entry_point="proving_ground.experiments.interfaces.gym_env.environment:FieldTrial",
    vector_entry_point="proving_ground.experiments.interfaces.gym_env.vector:field_trials",
)
