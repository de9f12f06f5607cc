"""Messages for logs and viewers."""
