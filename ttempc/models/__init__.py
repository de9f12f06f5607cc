"""Kinematic models of tractor and trailer."""
