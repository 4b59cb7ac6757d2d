"""Collects a demonstration and plots its actions: joint targets and opening over time. Needs genmanip and matplotlib.

    python examples/python/plot_dataset.py out/plotted actions.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import genmanip

run, picture = sys.argv[1:]
print(genmanip.collect("examples/tasks/017_pick_and_place.json", run, episodes=1, seed=7))
dataset = genmanip.Dataset(f"{run}/dataset")
actions = dataset.actions(0)
time_s = np.arange(len(actions)) / dataset.contract["rate_hz"]
joints, opening = plt.subplots(2, 1, sharex=True, figsize=(8, 6))[1]
joints.plot(time_s, actions[:, :-1], label=dataset.contract["names"][:-1])
joints.set_ylabel("joint targets, rad")
joints.legend(fontsize="x-small", ncols=4)
opening.plot(time_s, 1e3 * actions[:, -1])
opening.set(xlabel="time, s", ylabel="opening, mm")
plt.savefig(picture, dpi=120)
