"""Benchmark of controllers on frozen scenarios."""
