"""Benchmarks of cost and speed; `python -m proving_ground.experiments.benchmarks` runs them all."""
