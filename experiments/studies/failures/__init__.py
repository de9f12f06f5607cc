"""Failures of controllers: breaking points of one quantity, worst cases of several."""
