"""Sensors and their errors."""
