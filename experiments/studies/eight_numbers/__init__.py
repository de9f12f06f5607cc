"""Search for one set of parameters under which both published controllers err as published."""
