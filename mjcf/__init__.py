"""MJCF model and parameter files of the vehicles."""
