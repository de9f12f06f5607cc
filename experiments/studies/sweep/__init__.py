"""Sweeps: all runs of a study file, on any number of processes, one row per run."""
