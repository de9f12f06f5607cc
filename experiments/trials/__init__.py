"""Field trials: a benchmark of controllers on frozen scenarios."""
