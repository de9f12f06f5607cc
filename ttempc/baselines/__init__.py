"""What `ttempc` is measured against: conventional guidance, LQR and nonlinear MPC."""
