"""Many runs: from a study's file to a row a run, on any number of processes."""
