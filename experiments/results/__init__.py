"""Numbers of a run: tracking, containment, summary."""
