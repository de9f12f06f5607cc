"""Strict configuration files and the data files that ship with the project."""
