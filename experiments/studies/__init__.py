"""Studies: one small file a question, run by hand, their tables committed under docs/."""
