"""Learnt policies as controllers: observation, residual on a controller, policy files."""
