"""Plant side: field, vehicle, sensors, loop and log. Knows the controller's protocols only."""
