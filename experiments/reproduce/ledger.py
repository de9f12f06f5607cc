"""`docs/fingerprints.json`: what the committed tables were made with."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Final

from ...testbed.recording.provenance import code_digest, versions
from ..errors import InvalidPage
from .pages import ROOT, write_file
from .probes import Fingerprint, digest_of

LEDGER: Final = "docs/fingerprints.json"
_DATA: Final = ("experiments/scenarios", "experiments/sweeps", "experiments/fitted")


@dataclass(frozen=True, slots=True)
class Making:
    """Circumstances under which a table was made."""

    versions: Mapping[str, str]  # of project and packages
    source: str  # see `source_digest`
    probes: Mapping[str, Fingerprint]  # by name


@dataclass(frozen=True, slots=True)
class Ledger:
    """Circumstances of all committed tables, by the name of their entry."""

    entries: Mapping[str, Making] = field(default_factory=dict)

    def with_entry(self, name: str, making: Making) -> Ledger:
        """Return the ledger with one entry replaced or added."""
        return Ledger({**self.entries, name: making})

    def write(self, out: Path = ROOT) -> None:
        """Write the file; a fingerprint that several entries share stands in it once."""
        by_digest: dict[str, Any] = {}
        entries = {}
        for name, making in sorted(self.entries.items()):
            keys = {item: digest_of([found]) for item, found in making.probes.items()}
            by_digest |= {keys[item]: asdict(found) for item, found in making.probes.items()}
            entries[name] = {
                "versions": dict(making.versions),
                "source": making.source,
                "checks": keys,
            }
        lines = [f'  "{key}": {json.dumps(by_digest[key])}' for key in sorted(by_digest)]
        text = (
            '{\n "fingerprints": {\n' + ",\n".join(lines) + "\n },\n"
            ' "entries": ' + json.dumps(entries, indent=1).replace("\n", "\n ") + "\n}\n"
        )
        write_file(out / LEDGER, text.encode())


def read_ledger(out: Path = ROOT) -> Ledger:
    """Return the ledger; an empty one if nothing was made yet.

    Raises:
        InvalidPage: the file is not what `Ledger.write` writes.
    """
    file = out / LEDGER if (out / LEDGER).exists() else ROOT / LEDGER
    if not file.exists():
        return Ledger()
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
        known = {
            key: Fingerprint(item["sha256"], tuple(item["values"]))
            for key, item in content["fingerprints"].items()
        }
        return Ledger(
            {
                name: Making(
                    item["versions"],
                    item["source"],
                    {probe: known[key] for probe, key in item["checks"].items()},
                )
                for name, item in content["entries"].items()
            }
        )
    except (ValueError, KeyError, TypeError, AttributeError):
        raise InvalidPage(f"{file}: is not what `ttempc reproduce` writes") from None


def source_digest() -> str:
    """Return a hash of code, shipped data and package versions: equal ones need no probe."""
    digest = hashlib.sha256(code_digest().encode())
    for folder in _DATA:
        for file in sorted((ROOT / folder).glob("*.*")):
            digest.update(file.name.encode() + b"\0" + file.read_bytes())
    packages = {name: text for name, text in versions().items() if name != "commit"}
    digest.update(json.dumps(packages, sort_keys=True).encode())
    return digest.hexdigest()[:12]
