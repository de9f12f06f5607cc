"""Guidance of a tractor with a steerable trailer: references, estimation, MPC and tubes."""

__version__ = "0.2.0.dev0"
