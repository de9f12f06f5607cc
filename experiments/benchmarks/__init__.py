"""Figures of cost and speed: each module prints its own and says what they must hold."""
