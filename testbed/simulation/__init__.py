"""The plant and the loop that drives it."""
