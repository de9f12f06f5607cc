"""Tables for a paper: LaTeX with the rules of the package booktabs."""

import re
from collections.abc import Sequence
from typing import Final

import pandas as pd

_NUMBER: Final = re.compile(r"[-+]?\d|–")
_MINUS: Final = re.compile(r"(?<=[ (])-(?=\d)")


def latex_table(heads: Sequence[str], rows: Sequence[Sequence[str]], note: str) -> str:
    r"""Return a `tabular`, to be put into a `table` with a caption of one's own.

    Columns of numbers stand to the right, with their interval if they have one.

    Args:
        heads: of the columns.
        rows: cells as a reader sees them; what LaTeX reads otherwise is escaped.
        note: a comment above, on what the figures are.
    """
    frame = pd.DataFrame([list(row) for row in rows], columns=list(heads), dtype=str)
    numbers = [all(_NUMBER.match(cell) for cell in frame[head]) for head in heads]
    tabular = frame.to_latex(
        index=False,
        escape=True,
        column_format="".join("r" if number else "l" for number in numbers),
    )
    tabular = _MINUS.sub("$-$", tabular)  # a hyphen is shorter than a minus
    return f"% {note}\n% needs \\usepackage{{booktabs}}\n{tabular}"
