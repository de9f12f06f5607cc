"""Detectors of faults: one function each, one table of limits and reactions, one loop of alarms."""
