"""Where a controller meets a plant: scenarios, runs, metrics, figures, reports, command line."""
