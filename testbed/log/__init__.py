"""MCAP logs: writing, reading, recovery."""
