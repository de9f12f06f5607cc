"""The table of faults: every kind has a row, a description of each key, a way through pickle."""

import pickle
from dataclasses import asdict

import pytest
from proving_ground.testbed.faults.kinds import KINDS, AnyFault
from pydantic import TypeAdapter

KEYS = {"depth_m": 0.1, "body": "trailer", "sensor": "hitch", "side": "left", "wheel": "rear_left"}
KEYS |= {"axis": "roll", "factor": 2.0}


def test_every_kind_is_in_the_table_and_passes_pickle_and_its_own_dictionary():
    assert len(KINDS) == 53
    for kind, table in KINDS.items():
        needed = {key.name: KEYS.get(key.name, 1.0) for key in table.row.keys if key.default is ...}
        fault = table(kind=kind, at_m=5.0, **needed)
        assert pickle.loads(pickle.dumps(fault)) == fault
        again = TypeAdapter(AnyFault).validate_python(asdict(fault), strict=False)
        assert again == fault


@pytest.mark.parametrize("keys", [{}, {"start_s": 1.0, "at_m": 1.0}])
def test_a_fault_begins_at_a_time_or_at_a_place(keys):
    with pytest.raises(ValueError, match="start_s or at_m"):
        KINDS["encoder_dead"](**keys)
