"""Study of the learnt policy: one short field, in this process."""

import pytest
from proving_ground.experiments.policy import study
from proving_ground.experiments.studies.batch import BatchSettings, batch_settings


def test_rows_are_paired_with_the_controller_below_the_policy(capsys, monkeypatch):
    monkeypatch.setattr(study, "FIELDS", ("pavement",))
    with batch_settings(BatchSettings(workers=0)):
        study.main((201,), "path={kind='straight', length_m=10}")
    _, _, pid, policy, ttempc, _, _ = capsys.readouterr().out.splitlines()
    errors = {}
    for name, line in (("pid", pid), ("policy", policy), ("ttempc", ttempc)):
        field, label, both, difference, lost = (cell.strip() for cell in line.split("|")[1:-1])
        assert (field, lost) == ("`pavement`", "0")
        assert name in label
        errors[name] = sum(map(float, both.split("/"))) / 2.0
        if name == "pid":
            assert difference == ""
        else:
            change = float(difference.split()[0])
            assert change == pytest.approx(errors[name] - errors["pid"], abs=0.11)  # rounded
