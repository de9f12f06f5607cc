"""Published figures of real machines beside those of this plant."""
