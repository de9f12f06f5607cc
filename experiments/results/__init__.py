"""Numbers of a run: tracking errors, containment, summary."""
