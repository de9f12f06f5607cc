"""Settings of every process of the tests."""

from proving_ground.experiments.threads import use_one_thread

use_one_thread()  # pytest has a process for each core
