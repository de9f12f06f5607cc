"""Commands of `ttempc`, one per module.

Each module has `ABOUT`, the description of the command, and `add_arguments`, which declares its
arguments and sets the default `command` to the function that carries it out. That function takes
the parsed arguments and returns the exit code.
"""
