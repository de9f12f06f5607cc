"""Identification of vehicle parameters from recorded samples and commands."""
