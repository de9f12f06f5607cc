"""HTML report of a run, and the templates of all HTML pages."""
