"""Search for worst cases, and probability of failure."""
