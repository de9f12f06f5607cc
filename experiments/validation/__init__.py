"""Validation of a scenario's plant, with its report."""
