"""Training: the same search gives the same policy, and its file is one that drives."""

import numpy as np
from proving_ground.experiments.gym_env import training
from proving_ground.experiments.policy.linear_policy import read_policy


def test_a_search_repeats_itself_and_writes_a_policy(tmp_path, capsys):
    arguments = ["--scenarios", "pavement", "--periods", "5", "--generations", "2"]
    arguments += ["--population", "4", "--seed", "3"]
    files = [tmp_path / name for name in ("one.toml", "two.toml")]
    for file in files:
        training.main([*arguments, "-o", str(file)])
    assert files[0].read_text() == files[1].read_text()
    policy = read_policy(str(files[0]))
    gains = policy.matrix()
    assert np.count_nonzero(gains) == training.DIMENSION
    assert "pavement with seeds from 1 to 2" in policy.about
    assert "pid alone" in capsys.readouterr().out


def test_parameters_are_gains_times_sizes():
    """An entry of its size gives the action of its parameter."""
    policy = training.policy(np.arange(1.0, training.DIMENSION + 1.0))
    assert policy.gains["delta_t"]["y_t_e_m"] * 0.05 == 1.0
    assert policy.gains["hp"]["wheel_slip"] * 0.1 == training.DIMENSION
