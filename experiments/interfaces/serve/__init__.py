"""A plant over UDP: `ttempc serve`, its protocols and its session."""
