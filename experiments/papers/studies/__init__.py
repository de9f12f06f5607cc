"""Declarations of the studies: each module has `STUDIES`."""
