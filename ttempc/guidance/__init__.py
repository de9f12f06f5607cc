"""Guidance: estimator, controller, supervisor and limits as one object."""
