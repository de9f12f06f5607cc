"""Read a log into pandas and draw the figures of the paper, in notebook cells.

python docs/examples/read_a_log.py LOG.mcap [FOLDER]
"""

# %% Log and output folder
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from proving_ground.testbed.log.reader import read_log

log = Path(sys.argv[1])
folder = Path(sys.argv[2]) if len(sys.argv) > 2 else log.parent

# %% One data frame for each topic, indexed by time [s]; column names end with the unit
record = read_log(log)
frames = {
    topic: pd.DataFrame(table.values, columns=table.channel.fields, index=table.time_s)
    for topic, table in record.tables.items()
}
state, reference, control = frames["/state"], frames["/reference"], frames["/control"]
print(record.metadata["scenario"], record.metadata["controller"], record.metadata["seed"])

# %% Paths
figure, axes = plt.subplots(figsize=(8, 4))
axes.plot(reference.x_t_m, reference.y_t_m, "k--", label="reference")
axes.plot(state.x_t_m, state.y_t_m, label="tractor")
axes.plot(state.x_i_m, state.y_i_m, label="trailer")
axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
axes.legend()
figure.savefig(folder / "paths.png")

# %% Euclidean errors: distance from each point to its reference at the same time
errors = pd.DataFrame(
    {
        body: np.hypot(
            state[f"x_{letter}_m"] - reference[f"x_{letter}_m"],
            state[f"y_{letter}_m"] - reference[f"y_{letter}_m"],
        )
        for body, letter in (("tractor", "t"), ("trailer", "i"))
    }
)
print((100.0 * errors[errors.index >= 8.0].mean()).round(2).to_string())  # [cm], from 8 s on
figure, axes = plt.subplots(figsize=(8, 3))
(100.0 * errors).plot(ax=axes, xlabel="time [s]", ylabel="Euclidean error [cm]")
figure.savefig(folder / "euclidean_errors.png")

# %% Control signals: the parts of each input, their total and its bounds
inputs = (
    ("delta_t_rad", "front steering [deg]", 180.0 / np.pi),
    ("delta_i_rad", "trailer steering [deg]", 180.0 / np.pi),
    ("hp", "hydrostat [%]", 100.0),
)
figure, rows = plt.subplots(3, figsize=(8, 8), sharex=True)
for axes, (name, label, scale) in zip(rows, inputs, strict=True):
    for part in ("feedforward", "feedback", "robust", "total"):
        axes.plot(control.index, scale * control[f"{name}_{part}"], label=part, linewidth=0.8)
    for bound in ("min", "max"):
        axes.plot(control.index, scale * control[f"{name}_{bound}"], "k:", linewidth=0.8)
    axes.set_ylabel(label)
rows[0].legend(ncols=4)
rows[-1].set_xlabel("time [s]")
figure.savefig(folder / "control_signals.png")
