"""Where controllers fail: breaking points of one quantity, worst cases of several."""
