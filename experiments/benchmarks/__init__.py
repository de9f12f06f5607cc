"""Benchmarks of cost and speed; each module prints its figures and their limits."""
