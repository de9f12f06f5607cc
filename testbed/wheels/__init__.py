"""Law of tyres on soil, and wheels of any MuJoCo model that follow it."""
