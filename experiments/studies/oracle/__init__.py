"""Oracle: what the actuators of a plant permit on a ground that is known in advance."""
