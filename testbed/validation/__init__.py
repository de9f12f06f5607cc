"""Validation of a plant: experiments on a bench against closed forms and published values."""
