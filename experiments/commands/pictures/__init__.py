"""Commands that show a run: a film, a picture, a view."""
