"""CITATION.cff against the version of the library."""

import re
from pathlib import Path

import ttempc


def test_the_citation_names_this_version():
    text = (Path(__file__).parents[1] / "CITATION.cff").read_text()
    assert re.findall(r"^version: (.+)$", text, re.MULTILINE) == [ttempc.__version__]
