"""What a scenario file may hold: its JSON schema and its reference."""
