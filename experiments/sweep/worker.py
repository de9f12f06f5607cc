"""What a worker process on this machine is told as it starts; Dask's `--preload` takes it, too."""

from __future__ import annotations

import signal

from . import work  # noqa: F401 - loaded before the first run instead of in it


def dask_setup(worker: object) -> None:
    """Leave Ctrl-C to the driver, which ends the workers itself and says one line."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
