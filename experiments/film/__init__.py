"""Pictures and films of a run, from its log alone: in space (MuJoCo, EGL) and in plan (PIL)."""
