"""Files of other programs: lines, boundaries and records."""
