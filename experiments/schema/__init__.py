"""JSON schema and reference of scenario files."""
