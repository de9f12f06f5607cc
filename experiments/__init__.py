"""Experiments with a controller and a plant: scenarios, runs, sweeps, reports, command line."""
