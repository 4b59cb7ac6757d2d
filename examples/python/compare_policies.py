"""Evaluates two policies on scenarios and plots their scores with intervals. Needs genmanip and matplotlib.

    genmanip layout examples/tasks --count 3 --out out/scenarios
    python examples/python/compare_policies.py out/scenarios scores.png
"""

import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import genmanip
from press import Press

suite, picture = sys.argv[1:]
reports = genmanip.evaluate(suite, [Press, "expert"])
scores = [report["summary"]["success"] for report in reports]
values = np.array([score["value"] for score in scores])
reach = np.array([[score["value"] - score["low"], score["high"] - score["value"]] for score in scores]).T
plt.bar([report["label"] for report in reports], 100 * values, yerr=100 * reach, capsize=6)
plt.ylabel("success at end, % (95 % interval)")
plt.ylim(0, 105)
plt.savefig(picture, dpi=120)
