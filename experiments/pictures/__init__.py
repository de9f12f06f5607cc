"""Pictures of runs: figures, pages, films."""
