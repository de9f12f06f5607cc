"""Live view and interactive window."""
