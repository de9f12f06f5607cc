"""Faults on a timetable: one table of kinds, and what they act through."""
