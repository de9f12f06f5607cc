"""Studies of the default controller: its parts, its operating range, the limits of its error."""
