"""Preload module of Dask workers, on this machine or with `--preload`."""

from __future__ import annotations

import signal

from . import work  # noqa: F401 - loaded before the first run instead of in it


def dask_setup(worker: object) -> None:
    """Ignore Ctrl-C: the driver handles it, stops the workers and prints one line."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
