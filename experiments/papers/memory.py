"""Memory of a process; a module of its own, so that a worker that is asked loads nothing else."""

from pathlib import Path


def peak_mb() -> float:
    """Return the peak memory of this process [MB]; `getrusage` begins with the parent's."""
    lines = Path("/proc/self/status").read_text(encoding="utf-8").splitlines()
    return float(next(line for line in lines if line.startswith("VmHWM")).split()[1]) / 1024.0
