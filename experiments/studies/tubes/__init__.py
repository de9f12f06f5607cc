"""Fit of tubes to logged runs."""
