"""One run: from a scenario and a seed to its results."""
