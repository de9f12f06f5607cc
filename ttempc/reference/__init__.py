"""Paths, speeds along them, and the reference of both axle points."""
