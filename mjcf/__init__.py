"""The vehicle in MJCF: geometry, masses, joints, actuators, each number with its source."""
