"""Declarations of tables: each module has its `TABLES`."""
