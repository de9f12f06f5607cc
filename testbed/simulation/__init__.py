"""Plant, simulation loop and termination."""
