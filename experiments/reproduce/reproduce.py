"""Make tables and write them into their pages; find pages that are no longer true."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from ..errors import BadOptions
from ..sweep_report.format import format_numbers
from .driver import Driver, current_versions
from .entry import Entry
from .ledger import Ledger, Making, read_ledger, source_digest
from .pages import ROOT, check_block, read_page, with_block, write_file
from .probes import OUTCOMES, Fingerprint, Outcome, digest_of

_SHOWN: Final = ("commit", "code", "ttempc", "mujoco", "numpy", "piqp")

State = Literal["not made", "other probes"] | Outcome


@dataclass(frozen=True, slots=True)
class Verdict:
    """Whether a table is still true."""

    entry: Entry
    state: State
    probe: str = ""  # the worst one

    @property
    def holds(self) -> bool:
        """Return whether the table needs not be made anew."""
        return self.state in OUTCOMES[:2]


def select(entries: Sequence[Entry], names: Sequence[str]) -> list[Entry]:
    """Return the entries of these names; `all` is every one.

    Raises:
        BadOptions: there is no such entry.
    """
    known = {entry.name: entry for entry in entries}
    for name in names:
        if name not in known and name != "all":
            raise BadOptions(f"reproduce {name}: must be all or one of {', '.join(known)}")
    return [*entries] if "all" in names else [known[name] for name in dict.fromkeys(names)]


def reproduce(entries: Sequence[Entry], driver: Driver, out: Path = ROOT) -> Iterator[Entry]:
    """Make tables, one after the other, and yield each entry when its page is written.

    Args:
        entries: to make.
        driver: of their runs.
        out: folder that gets the pages; by default they are replaced in the checkout.

    Raises:
        InvalidPage: a page has no markers for a table; nothing is driven.
        ExperimentError, TestbedError, TtempcError: a run is refused; tables before it are written.
    """
    for entry in entries:
        check_block(entry.page, entry.name, out)
    driver.fingerprints([item for entry in entries for item in entry.all_probes()])
    for entry in entries:
        probes = driver.fingerprints(entry.all_probes())
        driver.versions = current_versions()
        product = entry.make(driver)
        making = Making(driver.versions, source_digest(), probes)
        seeds = entry.all_seeds()
        line = provenance(entry, making, driver.seeds(seeds) if seeds else ())
        text = with_block(read_page(entry.page, out), entry.name, f"{product.block}\n\n{line}")
        for name, content in product.files.items():
            write_file((out / entry.page).parent / name, content)
        write_file(out / entry.page, text.encode())
        read_ledger(out).with_entry(entry.name, making).write(out)
        yield entry


def provenance(entry: Entry, making: Making, seeds: Sequence[int]) -> str:
    """Return the line below a table: its command, seeds, versions and the digest of its probes."""
    parts = [f"`ttempc reproduce {entry.name}`"]
    if seeds:
        spans = format_numbers(seeds)
        parts.append(f"seed {spans}" if len(seeds) == 1 else f"seeds {spans}")
    known = (f"{name} {making.versions[name]}" for name in _SHOWN if name in making.versions)
    parts.append(", ".join(known))
    if making.probes:
        digest = digest_of([*making.probes.values()])
        count = len(making.probes)
        parts.append(f"{count} probe{'s' if count > 1 else ''} {digest}")
    return f"<sub>{'; '.join(parts)}</sub>"


def check(entries: Sequence[Entry], driver: Driver, out: Path = ROOT) -> list[Verdict]:
    """Drive the probes of all tables again and return what became of each table.

    Raises:
        InvalidPage: the record cannot be read.
    """
    ledger = read_ledger(out)
    made = [entry for entry in entries if entry.name in ledger.entries]
    now = driver.fingerprints([item for entry in made for item in entry.all_probes()])
    return [_verdict(entry, ledger, now) for entry in entries]


def known_state(entry: Entry, ledger: Ledger, source: str) -> str:
    """Return what is known of a table without a drive."""
    making = ledger.entries.get(entry.name)
    if making is None:
        return "not made"
    return "fresh" if making.source == source else "code or data changed: --check"


def _verdict(entry: Entry, ledger: Ledger, now: Mapping[str, Fingerprint]) -> Verdict:
    making = ledger.entries.get(entry.name)
    if making is None:
        return Verdict(entry, "not made")
    names = {item.name for item in entry.all_probes()}
    if other := names ^ making.probes.keys():
        return Verdict(entry, "other probes", min(other))
    compared = [(OUTCOMES.index(making.probes[name].compare(now[name])), name) for name in names]
    worst, name = max(compared, default=(0, ""))
    return Verdict(entry, OUTCOMES[worst], name if worst else "")
