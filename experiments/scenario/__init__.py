"""Scenarios: files, defaults and validation."""
