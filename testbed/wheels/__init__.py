"""Wheel models: the law of tyres on soil, and contacts of MuJoCo."""
