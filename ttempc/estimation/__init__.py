"""State estimation from measurements."""
