"""Sweep reports: rows aggregated and rendered as an HTML page, Markdown and pictures."""
