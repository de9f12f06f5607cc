"""Checks and exports of logs; layouts for viewers."""
