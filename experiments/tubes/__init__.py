"""Fitting of tubes to logged runs."""
