"""Feedback laws of the controllers."""
