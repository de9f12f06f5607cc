"""Soil-working implement on the trailer: draft, side force, depth, lift."""
