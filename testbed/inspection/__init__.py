"""Inspection of the plant: experiments with a known answer, and whether the plant gives it."""
