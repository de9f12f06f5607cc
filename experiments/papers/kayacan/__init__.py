"""NMPC and moving-horizon estimator published for the vehicle of the paper."""
