"""Many runs: sweeps, searches, the benchmark's trials, fits of tubes."""
