"""Experiments that give this plant's figures beside published ones, in the order of the page.

Each takes a constant that is wrong, or `RIGHT`, and returns its figures in the order of
`studies/evidence.toml`, which has the published ones.
"""
