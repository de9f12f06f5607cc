"""Faults: limits of the detectors, and what becomes of runs with a fault."""
