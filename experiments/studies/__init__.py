"""Studies, run by hand; their tables are part of the pages in docs/."""
