"""Shape and strength of the ground."""
