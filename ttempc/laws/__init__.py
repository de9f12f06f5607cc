"""Feedback laws of the controllers, and the frame around them."""
