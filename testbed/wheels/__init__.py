"""Wheel models: tyres on soil, and contacts of MuJoCo."""
