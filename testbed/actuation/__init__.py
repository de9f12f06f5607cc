"""Command path: from a command to the set points of the servos."""
