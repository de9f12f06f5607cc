"""Channels, rows and records of a run."""
