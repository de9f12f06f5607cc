"""Run, record and plot from Python; cells for a notebook.

python docs/examples/run_and_plot.py [FIGURE.png]
"""

# %% Run one lap in memory
import sys

import matplotlib.pyplot as plt

from proving_ground import load, simulate
from proving_ground.testbed.recording.channels import CONTROL, REFERENCE, STATE

name, scenario = load("wet-slope", ["path.laps=1", "soil.cone_index_kpa=400.0"])
summary, record = simulate(name, scenario, seed=3)
print(summary.status, summary.tracking.all.trailer.mean_euclidean_m)

# %% Every channel is a table of numpy columns; units stand in their names
state, reference, control = record[STATE], record[REFERENCE], record[CONTROL]
figure, (plan, inputs) = plt.subplots(2, figsize=(7, 7), constrained_layout=True)
plan.plot(reference["x_i_m"], reference["y_i_m"], "k--", label="reference")
plan.plot(state["x_i_m"], state["y_i_m"], label="trailer")
plan.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
plan.legend()
inputs.plot(control.time_s, control["delta_t_rad_command"], label="front steering")
inputs.plot(control.time_s, control["delta_i_rad_command"], label="trailer steering")
inputs.set(xlabel="time [s]", ylabel="command [rad]")
inputs.legend()
figure.savefig(sys.argv[1] if len(sys.argv) > 1 else "run.png", dpi=120)
