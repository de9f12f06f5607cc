"""Baseline controllers and estimators: conventional guidance, LQR, nonlinear MPC."""
