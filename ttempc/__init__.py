"""Control side: paths, references, models, controllers and estimators. Knows nothing of MuJoCo."""
