"""Pictures and films of a run from its log: rendered by MuJoCo, or drawn in plan without OpenGL."""
