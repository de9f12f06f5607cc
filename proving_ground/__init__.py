"""Import root of the proving ground: `testbed`, `experiments` and `mjcf` under one name."""
