"""Entry of the list of tables: its page, its seeds, its probes, and the function that makes it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from ..sweep.study import load_study
from .probes import Probe, probe, study_probes

if TYPE_CHECKING:
    from .driver import Driver


@dataclass(frozen=True, slots=True)
class Product:
    """Result of an entry."""

    block: str  # Markdown, between the markers of the entry in its page
    files: Mapping[str, bytes] = field(default_factory=dict)  # beside the page, by relative path


@dataclass(frozen=True, kw_only=True, slots=True)
class Entry:
    """A table, with its figures."""

    name: str
    page: str  # that has its markers, relative to the checkout
    make: Callable[[Driver], Product]
    sweeps: tuple[str, ...] = ()  # studies whose rows it is made from
    seeds: tuple[int, ...] = ()  # of runs of its own
    probes: tuple[tuple[str, ...], ...] = ()  # scenario, controller, changes; those of sweeps apart
    minutes: float = 0.0  # of runs of its own, on two cores; measured or estimated

    def all_seeds(self) -> tuple[int, ...]:
        """Return the seeds of all runs behind the table."""
        studies = (load_study(name)[1].point_seeds for name in self.sweeps)
        return tuple(sorted({*self.seeds, *(seed for seeds in studies for seed in seeds)}))

    def all_probes(self) -> tuple[Probe, ...]:
        """Return the probes behind the table."""
        own = (probe(*words) for words in self.probes)
        return (*(item for name in self.sweeps for item in study_probes(name)), *own)
