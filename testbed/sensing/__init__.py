"""Sensors, their errors, and an estimator that returns the truth."""
