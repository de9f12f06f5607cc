"""Commands over many runs: studies, their comparison, and what is fitted to them."""
