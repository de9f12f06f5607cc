"""Options of controllers from tables: types, names, ranges."""

from dataclasses import asdict, fields

import pytest

from ttempc.errors import InvalidTuning
from ttempc.guidance.controllers import CONTROLLERS, parse_options

KINDS = {entry.options for entry in CONTROLLERS.values() if entry.options_type}
by_kind = pytest.mark.parametrize("kind", sorted(KINDS, key=lambda kind: kind.__name__))


@by_kind
def test_a_value_of_another_type_is_refused_with_its_name(kind):
    for item in fields(kind):
        for wrong in (None, "wrong", [], ["wrong"], {}, float("nan")):
            with pytest.raises(InvalidTuning, match=rf"^controller\.options\.{item.name}"):
                parse_options(kind, {item.name: wrong})


@by_kind
def test_defaults_written_as_a_file_has_them_give_the_defaults(kind):
    table = {
        name: list(value) if isinstance(value, tuple) else value
        for name, value in asdict(kind()).items()
    }
    assert parse_options(kind, table) == kind()


def test_whole_numbers_become_floats_where_the_default_is_one():
    options = CONTROLLERS["ttempc"].options
    parsed = parse_options(options, {"step_weight": [1, 1, 1], "memory_s": 5, "horizon": 12})
    assert [type(weight) for weight in parsed.step_weight] == [float, float, float]
    assert type(parsed.memory_s) is float
    assert type(parsed.horizon) is int
