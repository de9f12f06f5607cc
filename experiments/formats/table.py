"""Table of a foreign file."""

from typing import Literal

Coordinates = Literal["degrees", "metres", "map"]
"""Coordinates of a file: latitude and longitude, eastings and northings, or our map frame."""
