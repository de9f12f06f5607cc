"""Plant side: field, vehicle, sensors, loop and log; it depends on controller protocols only."""
