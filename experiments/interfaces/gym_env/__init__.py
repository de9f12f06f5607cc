"""Gymnasium environment of the proving ground; importing it registers `ttempc/FieldTrial-v2`."""

import gymnasium

ENVIRONMENT_ID = "ttempc/FieldTrial-v2"

gymnasium.register(
    ENVIRONMENT_ID,
    entry_point="proving_ground.experiments.interfaces.gym_env.environment:FieldTrial",
)
