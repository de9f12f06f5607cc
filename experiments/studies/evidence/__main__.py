"""Published figures beside ours, as published in docs/evidence.md.

    python -m experiments.studies.evidence

Prints verdict and table; `ttempc reproduce evidence` puts them into the page.
"""

from __future__ import annotations

from .page import evidence_page

if __name__ == "__main__":
    print(evidence_page(), end="")
