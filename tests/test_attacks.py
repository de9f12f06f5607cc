"""Some attacks of each class that takes no minutes; all of them: `python -m tests.attacks`."""

from itertools import islice

import pytest

from tests import attacks


@pytest.mark.parametrize("name", ["samples", "gym", "options", "maps", "models", "trust"])
def test_attacks_are_refused_in_a_line_and_change_nothing(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # and back: attacks of `trust` go to their folder
    monkeypatch.syspath_prepend(tmp_path)
    for attack in islice(getattr(attacks, name)(tmp_path), 0, 12, 3):
        assert not attack()
