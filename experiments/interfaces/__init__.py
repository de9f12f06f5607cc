"""Runs that something else drives: over UDP, as a Gymnasium environment."""
