"""Plant validation: the card of a scenario."""
