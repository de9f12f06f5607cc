"""The tables of a scenario: each room holds what a table may say and what is made of it."""
