"""Studies behind the tables of README and docs; not part of the wheel."""
