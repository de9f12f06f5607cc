"""Tables and figures of the documentation: what makes them, and whether they are still true."""
