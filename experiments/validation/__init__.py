"""Plant validation: inspection of a scenario's plant, with its report."""
