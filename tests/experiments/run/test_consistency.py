"""The filter on the plant: is its covariance honest where its model nearly holds?"""

import numpy as np
from scipy.stats import chi2

from proving_ground.experiments.run.simulate import simulate
from proving_ground.experiments.scenario.scenario import load
from proving_ground.testbed.recording.channels import ESTIMATE


def test_innovations_on_pavement_are_as_large_as_the_filter_says():
    _, record = simulate(*load("pavement"), seed=11)
    table = record[ESTIMATE]
    total, freedom = np.nansum(table["nis"]), np.nansum(table["nis_dof"])
    assert freedom > 20_000  # two laps, every sensor at its own rate
    low, high = chi2.ppf([0.025, 0.975], freedom)
    assert low < total < high, f"normalised innovation squared {total / freedom:.4f} a degree"
