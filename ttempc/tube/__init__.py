"""Disturbance sets, invariant tubes and tightened constraints."""
