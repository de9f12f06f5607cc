"""Detectors of faults: what they observe, when they give an alarm, what follows from it."""
