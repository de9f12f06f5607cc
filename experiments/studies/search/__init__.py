"""Search for failures: limit of one quantity by bisection, worst case of several by CMA-ES."""
