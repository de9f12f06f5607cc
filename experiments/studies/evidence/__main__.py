"""Published figures beside ours, as published in docs/evidence.md.

    python -m experiments.studies.evidence [PAGE]

Writes the page, or prints it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from .page import evidence_page


def main(arguments: list[str]) -> None:
    """Make all figures and write the page."""
    content = evidence_page()
    if arguments:
        Path(arguments[0]).write_text(content, encoding="utf-8")
    else:
        print(content, end="")


if __name__ == "__main__":
    main(sys.argv[1:])
