"""Faults on a timetable: of samples, of the command path, of the plant and of the ground."""
